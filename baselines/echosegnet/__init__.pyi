# The public names of echosegnet: type checkers read them here, and lazy_loader imports them from here on first use.
from .pipeline import Prediction as Prediction
from .pipeline import Settings as Settings
from .pipeline import predict as predict
from .run import write_echosegnet as write_echosegnet
from .run import write_sweep as write_sweep
from .sources import FolderMasks as FolderMasks
from .sources import OracleMasks as OracleMasks
