"""Articulated objects in depth images: a camera, its noise and place, models of objects, and a tracker of
where they are, alone or in trials in physics."""

from ._calibrate import Calibration as Calibration
from ._calibrate import calibrate_camera as calibrate_camera
from ._camera import Camera as Camera
from ._depth_tracker import DepthSight as DepthSight
from ._depth_tracker import DepthTracker as DepthTracker
from ._depth_tracker import Tracking as Tracking
from ._depth_tracker import depth_tracker as depth_tracker
from ._evidence import Evidence as Evidence
from ._evidence import evidence as evidence
from ._frames import DepthFrames as DepthFrames
from ._frames import open_frames as open_frames
from ._frames_writer import AddFrame as AddFrame
from ._frames_writer import frames_writer as frames_writer
from ._measured_points import OBJECT as OBJECT
from ._measured_points import OTHER as OTHER
from ._measured_points import ROBOT as ROBOT
from ._measured_points import MeasuredPoints as MeasuredPoints
from ._measured_points import measured_points as measured_points
from ._noise import KINECT as KINECT
from ._noise import PERFECT_DEPTH as PERFECT_DEPTH
from ._noise import DepthNoise as DepthNoise
from ._noise import axial_sigma as axial_sigma
from ._noise import measured_depth as measured_depth
from ._object_model import ObjectModel as ObjectModel
from ._object_model import object_model as object_model
from ._overhead import looked_at as looked_at
from ._overhead import overhead_camera as overhead_camera
from ._render import depth_renderer as depth_renderer
from ._robot_object import robot_object as robot_object
from ._robot_seen import robot_spheres as robot_spheres
from ._settings import ObjectTrackerSettings as ObjectTrackerSettings
from ._track import Estimate as Estimate
from ._track import start_estimate as start_estimate
from ._track import track as track
