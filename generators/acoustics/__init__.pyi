# The public names of generators.acoustics: type checkers read them here, lazy_loader imports them on first use.
from . import habitat as habitat
from .engines import Analytic as Analytic
from .engines import Engine as Engine
from .engines import SoundSpaces as SoundSpaces
from .engines import Tracer as Tracer
from .rir import Rir as Rir
from .rooms import MaterialUse as MaterialUse
from .rooms import Room as Room
from .shards import write_webdataset as write_webdataset
from .tracer.arrivals import Arrivals as Arrivals
from .tracer.receivers.ambisonics import Ambisonics as Ambisonics
from .tracer.receivers.measured import SofaHead as SofaHead
from .tracer.receivers.microphones import Array as Array
from .tracer.receivers.microphones import Omni as Omni
from .tracer.receivers.spherical import SphericalHead as SphericalHead
from .tracer.settings import TraceSettings as TraceSettings
from .tracks import Pose as Pose
