# The public names of foundation: type checkers read them here, and lazy_loader imports them from here on first use.
from .run import Foundation as Foundation
from .run import load_foundation as load_foundation
from .run import write_foundation as write_foundation
