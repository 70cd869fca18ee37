# The public names of owod_bind: type checkers read them here, and lazy_loader imports them from here on first use.
from .run import OwodBind as OwodBind
from .run import load_owod_bind as load_owod_bind
from .run import write_mask_folder as write_mask_folder
from .run import write_owod_bind as write_owod_bind
