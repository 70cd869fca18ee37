# The public names of baselines.listener: type checkers read them here, and lazy_loader imports them on first use.
from .model import Listener as Listener
from .model import Widths as Widths
from .training import Settings as Settings
from .training import train as train
from .weights import load_listener as load_listener
from .weights import save_weights as save_weights
