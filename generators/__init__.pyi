# The public names of generators: type checkers read them here, and lazy_loader imports them from here on first use.
from . import acoustics as acoustics
from . import objects as objects
from .home import Home as Home
from .manifest.reading import ManifestFile as ManifestFile
from .manifest.reading import read_manifest as read_manifest
from .manifest.schema import Manifest as Manifest
from .run.generation import generate as generate
from .run.runner import Outcome as Outcome
from .scenes.home_scene import HomeScene as HomeScene
from .scenes.renderer import Renderer as Renderer
from .vision.base import RenderedView as RenderedView
