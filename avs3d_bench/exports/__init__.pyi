# The public names of exports: type checkers read them here, and lazy_loader imports them from here on first use.
from .card import write_card as write_card
from .codabench import write_codabench as write_codabench
from .croissant import write_croissant as write_croissant
from .huggingface import waveform as waveform
from .huggingface import write_huggingface as write_huggingface
from .qa.write import QaOptions as QaOptions
from .qa.write import write_qa as write_qa
from .release.get import find_release as find_release
from .release.get import get_release as get_release
from .release.write import ReleaseSettings as ReleaseSettings
from .release.write import write_release as write_release
from .seld.write import SeldSettings as SeldSettings
from .seld.write import write_seld as write_seld
from .shard_files import shard_paths as shard_paths
from .torch_dataset import AVS3DDataset as AVS3DDataset
from .webdataset import decode_sample as decode_sample
from .webdataset import write_webdataset as write_webdataset
