"""A Franka of franky-sim that somebody guides by hand, over and over: run in franky-sim's environment by the tests.

Its joints are led along a slow swing, as a hand would, while the robot itself is idle; the network side is
franky-sim's.
"""

import math
import sys

import franky_sim
from franky_sim.mujoco_simulator import MujocoSimulator

BASE = (0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785)

with MujocoSimulator(enable_visualization=False) as sim:
    sim.add_robot(initial_q=BASE)
    with franky_sim.SimulationServer(sim, hostname_candidates=[sys.argv[1]]) as server:
        robot_server, time = server.robot_servers[0], 0.0
        while True:
            swing = 0.2 * math.sin(1.5 * time)
            held = tuple(q + swing * (k in (0, 3)) for k, q in enumerate(BASE))
            robot_server._FrankaRobotServer__holding_q = held
            server.run_once()
            time += 0.001
