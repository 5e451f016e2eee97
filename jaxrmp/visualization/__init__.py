"""Pictures of what was learned and of how well it is reproduced. Functions return figures; nothing is shown."""

from ._energy import energy_figure as energy_figure
from ._evaluation import evaluation_figures as evaluation_figures
from ._inspection import inspection_figure as inspection_figure
from ._loss import loss_figure as loss_figure
from ._physics import physics_figure as physics_figure
from ._plane import Plane as Plane
from ._plane import PlaneField as PlaneField
from ._plane import demonstration_plane as demonstration_plane
from ._plane import field_on_plane as field_on_plane
from ._save import png as png
from ._save import save_learning_figures as save_learning_figures
from ._save import save_physics_figures as save_physics_figures
from ._save import save_reproduction_figures as save_reproduction_figures
from ._style import figure_style as figure_style
from ._triangles import triangle_figure as triangle_figure
from ._vector_field import vector_field_figure as vector_field_figure
from ._video import check_video_name as check_video_name
from ._video import prepare_headless as prepare_headless
from ._video import save_video as save_video
from ._video import snapshots as snapshots
from ._widths import width_figure as width_figure
