# The public names of evaluators.metrics: type checkers read them here, and lazy_loader imports them on first use.
from . import pointing as pointing
from .accumulator import Accumulator as Accumulator
from .accumulator import evaluate as evaluate
from .contour import boundary_f as boundary_f
from .contour import contour as contour
from .conventions import avsbench as avsbench
from .conventions import avss as avss
from .conventions import combo as combo
from .conventions import ref_avs as ref_avs
from .masks import FrameCounts as FrameCounts
from .masks import f_measure as f_measure
from .masks import frame_counts as frame_counts
from .masks import iou as iou
from .masks import mean as mean
from .masks import official_f as official_f
from .masks import official_miou as official_miou
from .soft import average_precision as average_precision
