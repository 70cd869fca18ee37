# The public names of baselines.listener: type checkers read them here, and lazy_loader imports them on first use.
from .checkpoint import Settings as Settings
from .model import Listener as Listener
from .model import Widths as Widths
from .predict import load_method as load_method
from .predict import write_listener as write_listener
from .training import prepare as prepare
from .training import train as train
from .weights import load_listener as load_listener
from .weights import save_weights as save_weights
