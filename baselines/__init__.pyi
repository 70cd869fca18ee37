# The public names of baselines: type checkers read them here, and lazy_loader imports them from here on first use.
from . import denseav as denseav
from . import echosegnet as echosegnet
from . import foundation as foundation
from . import listener as listener
from . import oracle as oracle
from . import owod_bind as owod_bind
from . import references as references
from . import trivial as trivial
