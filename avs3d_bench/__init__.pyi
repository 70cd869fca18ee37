# The public names of avs3d_bench: type checkers read them here, and lazy_loader imports them from here on first use.
from . import geometry as geometry
from .commands.report import Problem as Problem
from .commands.report import Report as Report
from .contract import layout as layout
from .contract import schema as schema
from .dataset import Dataset as Dataset
from .dataset import Frame as Frame
from .dataset import Observation as Observation
from .errors import Avs3dError as Avs3dError
from .errors import UsageError as UsageError
from .formats import media as media
from .geometry import Intrinsics as Intrinsics
from .geometry import Pose as Pose
from .submission import Prediction as Prediction
from .submission import SubmissionWriter as SubmissionWriter
from .validate import validate as validate

__version__: str
