"""`python -m benchmarks.coded_clips ROOT -o COPY --codec mp3`: a dataset whose binaural clips were coded with losses.

Each clip is written as Ogg Vorbis or MP3 by libsndfile and read again, both ears in one stream; pictures, truth and
poses are the same files (hard links). So the same observations tell what a codec costs a method.
"""

from __future__ import annotations

import os
import shutil
from functools import partial
from pathlib import Path

import click
import numpy as np
import soundfile

from avs3d_bench.contract.layout import BINAURAL, SAMPLE_RATE, audio_path
from avs3d_bench.dataset import Dataset
from avs3d_bench.errors import Avs3dError
from avs3d_bench.formats.media import write_wav
from avs3d_bench.formats.staging import staged_folder
from baselines.listener.codecs import CODECS, coded


def _free(root: Path, path: Path) -> None:
    if path.exists():
        raise Avs3dError(f"{path} exists; name a folder that does not")
    if path.is_relative_to(root.resolve()):
        raise Avs3dError(f"{path} lies in {root}, which is copied; name a folder outside")


@click.command()
@click.argument("root", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The copy: a new folder.")
@click.option("--codec", type=click.Choice(list(CODECS)), default="mp3", show_default=True)
@click.option("--level", type=click.FloatRange(0, 1), default=0.8, show_default=True, help="0: best, 1: smallest.")
def main(root: Path, output: Path, codec: str, level: float) -> None:
    """Copy the dataset ROOT with coded clips, and print the median bit rate."""
    rates = []
    try:
        dataset = Dataset(root)
        with staged_folder(output, partial(_free, root)) as copy:
            shutil.copytree(
                root, copy, copy_function=os.link, ignore=shutil.ignore_patterns(BINAURAL), dirs_exist_ok=True
            )
            for observation in dataset:
                (copy / observation.key / BINAURAL).mkdir()
                for frame in observation.frames:
                    samples, kbits = coded(frame.audio(), SAMPLE_RATE, codec, level)
                    write_wav(copy / observation.key / audio_path(BINAURAL, frame.index), samples)
                    rates.append(kbits)
    except shutil.Error as error:
        raise click.ClickException(f"{output}: hard links fail, name a folder on the disk of {root}: {error}") from None
    except soundfile.SoundFileError as error:
        raise click.ClickException(f"{codec} at --level {level:g}: {error}; name a lower level") from None
    except Avs3dError as error:
        raise click.ClickException(str(error)) from None
    click.echo(f"{len(rates)} clips, {codec}, {np.median(rates):.0f} kbit/s in the median")


if __name__ == "__main__":
    main()
