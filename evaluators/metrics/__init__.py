"""Figures of masks, volumes and classes, as pure functions; those of masks are named here, too."""

from evaluators.metrics.masks import U8 as U8
from evaluators.metrics.masks import FrameCounts as FrameCounts
from evaluators.metrics.masks import as_bytes as as_bytes
from evaluators.metrics.masks import f_measure as f_measure
from evaluators.metrics.masks import frame_counts as frame_counts
from evaluators.metrics.masks import iou as iou
from evaluators.metrics.masks import mean as mean
from evaluators.metrics.masks import official_f as official_f
from evaluators.metrics.masks import official_miou as official_miou
