"""The pages and the picture of a competition bundle."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from avs3d_bench import __version__
from avs3d_bench.contract import layout
from avs3d_bench.contract.competition import DECIMALS, Column
from avs3d_bench.contract.scores import METRICS
from avs3d_bench.contract.taxonomy import PART_3

#: How participants install this toolkit, if the organiser does not say otherwise.
INSTALL = f"pip install avs3d-bench=={__version__}"
#: Side of the drawn picture (pixels).
_SIDE = 256


@dataclass(frozen=True)
class CompetitionFacts:
    """Facts on the pages of a competition.

    Attributes:
        title: of the competition.
        dataset: its name.
        version: of the dataset; None where it has none.
        licence: of the dataset; None where it is not known.
        phases: name, observations, masks, start, end, most submissions of each.
        parts: of the dataset.
        columns: of the leaderboard.
        example: key of an observation.
        data_url: address of the data; None: they are among the files of the phase.
        sealed: whether commitments were published with the data.
        install: command that installs this toolkit.
        practice: whether the starting kit has practice data.
    """

    title: str
    dataset: str
    version: str | None
    licence: str | None
    phases: tuple[tuple[str, int, int, datetime, datetime | None, int], ...]
    parts: tuple[str, ...]
    columns: tuple[Column, ...]
    example: str
    data_url: str | None
    sealed: bool
    install: str
    practice: bool


def pages(facts: CompetitionFacts) -> dict[str, str]:
    """File → text of the pages, in Markdown."""
    return {"overview.md": _overview(facts), "data.md": _data(facts), "evaluation.md": _evaluation(facts)}


def _overview(facts: CompetitionFacts) -> str:
    rows = "\n".join(
        f"| {name} | {start:%Y-%m-%d %H:%M} | {f'{end:%Y-%m-%d %H:%M}' if end else 'open'} | {count} | {masks:,} | "
        f"{most} |"
        for name, count, masks, start, end, most in facts.phases
    )
    task = (
        "An agent walks through a home with a camera and two ears. For each test frame, mark the pixels of the object "
        "that sounds."
    )
    if PART_3 in facts.parts:
        task += (
            " In part_3 several objects may sound, or none: mark all that is audible and visible. Observations of a "
            "group have the same pictures and different sound, so that a method that does not listen cannot be right "
            "in both."
        )
    return f"""# {facts.title}

{task}

| Phase | Starts (UTC) | Ends (UTC) | Observations | Masks | Submissions |
|---|---|---|---:|---:|---:|
{rows}

Submit masks, not code. The pages "Data" and "Evaluation" say what you get and what you hand in.
"""


def _data(facts: CompetitionFacts) -> str:
    version = f" {facts.version}" if facts.version else ""
    licence = f", licence {facts.licence}" if facts.licence else ""
    where = facts.data_url or 'The data are the file "Public data" of the phase.'
    seal = (
        "\n`seal.json` commits the organisers to the truth: it has a commitment (sha256) to every hidden file and to "
        "the secret from which all was generated. After the competition the secret is published, and anyone can check "
        "with `avs3d unseal` that nothing was changed.\n"
        if facts.sealed
        else ""
    )
    poses = f"| `{layout.POSES_JSON}` | camera, and its pose at each frame |\n" if facts.sealed else ""
    return f"""# Data

{where}

The dataset is {facts.dataset}{version}{licence}. Each observation is a folder,
such as `{facts.example}/`:

| Path | Contents |
|---|---|
| `{layout.INPUT}/frame_000.png` … | pictures, one a second |
| `{layout.BINAURAL}/frame_0.wav` … | the second of sound at each picture, left and right ear, 44.1 kHz |
| `{layout.MONO}/frame_0.wav` … | two seconds of sound around it, one channel |
| `{layout.COLMAP}/` | camera poses and sparse points in COLMAP's format |
| `{layout.SPLITS_JSON}` | which frames are train and which are test |
{poses}
The truth of the test frames is not public. {_practice(facts)}
{seal}
## Axes, angles, ears

- The world is right-handed, in metres, **Y up**. A camera looks down its **−Z**, with +X right and +Y up; a pose is its
  position and a unit quaternion (w, x, y, z), camera to world.
- `{layout.COLMAP}/` is in COLMAP's convention, turned by 180° about X, so that **Y points down**: (x, y, z) there is
  (x, −y, −z) here.
- **Azimuth** is 0 ahead and positive to the **right**, in degrees; elevation is positive up. (DCASE counts azimuth
  positive to the left.)
- Channel 0 of a clip is the **left** ear. A source on the right is louder, and earlier, in channel 1.
- The centre of pixel (column u, row v) is at (u + 0.5, v + 0.5). Camera and ears are at one place, 1.5 m above the
  floor.
- Clip i is the second that begins with frame i; what sounded before may still reverberate in it.
"""


def _practice(facts: CompetitionFacts) -> str:
    if facts.practice:
        return "`practice/` in the starting kit is a dataset of other homes *with* its truth: score there what you try."
    return "For practice, generate a dataset with its truth (`avs3d generate`; see the documentation of avs3d-bench)."


def kit_readme(facts: CompetitionFacts) -> str:
    """README.md of the starting kit: the way from installation to a submission."""
    practice, scored = "", ""
    if facts.practice:
        practice = "- `practice/`: data of other homes, with the truth\n"
        scored = " scored on the practice data, then"
    return f"""# {facts.title}: starting kit

```
{facts.install}
```

The network of the notebook needs PyTorch as well: {with_baselines(facts.install)}

{practice}- `listener.ipynb`: a baseline that looks and listens,{scored} run on the test, checked, and packed as a
  submission
- `example/`: a submission with every file that is expected; it marks a box in the middle of every picture
- `pages/`: the pages of the competition: data, axes and angles, what to hand in, how it is scored

In short, with the data in `public/`:

```
avs3d baseline listener --dataset public -o my-submission    # or your method
avs3d check my-submission --dataset public
cd my-submission && zip -r ../my-submission.zip .
```
"""


def with_baselines(install: str) -> str:
    """What installs the baselines, too, as Markdown: the command with the extra, if it names the requirement.

    Examples:
        >>> with_baselines("pip install avs3d-bench==0.1.0")
        '`pip install avs3d-bench[baselines]==0.1.0`'
        >>> with_baselines("pip install git+https://example.org/avs3d-bench@v0.1.0")
        'install the extra `[baselines]`.'
    """
    # The name of the requirement, not a part of its address.
    named, count = re.subn(r"(?<![\w/.-])avs3d-bench(?![\w.\[-])", "avs3d-bench[baselines]", install, count=1)
    if count:
        return f"`{named}`"
    return "install the extra `[baselines]`."


def _evaluation(facts: CompetitionFacts) -> str:
    names = dict.fromkeys((column.protocol, column.figure) for column in facts.columns)
    known = {(metric.protocol, metric.name): metric for metric in METRICS}
    rows = "\n".join(
        f"| {m.protocol} {m.title} | {'higher' if m.higher_is_better else 'lower'} | {m.meaning} |"
        for m in (known[pair] for pair in names)
    )
    scenes = f"\n{_scene_files()}" if PART_3 in facts.parts else ""
    groups = (
        " In part_3, pair accuracies (twins, all pairs, the other kinds) are means over groups of siblings, and "
        "intervals are over homes, then groups."
        if PART_3 in facts.parts
        else ""
    )
    said = f'{{"method": "…", "dataset": "{facts.dataset}", "dataset_version": "{facts.version or "unversioned"}"}}'
    return f"""# Evaluation

## What to hand in

A zip archive with `submission.json` and the masks at its root:

```
submission.json
{facts.example}/{layout.SUBMISSION_MASKS}/frame_000.png
…
```
{scenes}
- `submission.json` is `{said}`.
- One PNG for each test frame of each observation, of the size of the picture, with 0 and 255 only.
- Masks of observations of another phase may be in the archive; they are not looked at.
- `example/` in the starting kit has every file that is expected and marks a box in the middle. Write your masks over
  it.
{_points(facts)}
Check it before you submit, with avs3d-bench {__version__}, which scores it here:

```
{facts.install}
avs3d check my-submission.zip --dataset PATH-OF-THE-DATA
```

A submission with a bad or missing file gets no score. The log of the submission names such files, a
hundred of them at most; `avs3d check` names all.

## How it is scored

`{facts.columns[0].title}` ranks. Figures are means over observations, with {DECIMALS} decimals.{groups}

From six observations on, a mean has a 95 % bootstrap interval. It belongs to one method and does not compare two: they
may differ although their intervals overlap, because both mark the same observations. `avs3d leaderboard`, which the
organisers can run on the files of scores, compares methods observation by observation.

| Figure | Better | Meaning |
|---|---|---|
{rows}

The last submission of a participant counts.
"""


def _points(facts: CompetitionFacts) -> str:
    """The lines on 3D predictions, which observations of part_1 and part_2 may have."""
    if not {"part_1", "part_2"} & {*facts.parts}:
        return ""
    return f"""- `{layout.SUBMISSION_POINTS}` beside `{layout.SUBMISSION_MASKS}/` is an optional 3D prediction, in
  all observations or in none: points on the object that sounds, as the vertices of a PLY file, in the world of the data
  (metres, Y up; turn points of COLMAP's world back). Every vertex counts, so leave out what is not the object; at most
  {layout.MAX_POINTS:,}. Points are put into voxels of 5 cm and compared with those of the object: `strict 3D IoU` and
  `strict centroid error`. A submission without points has neither, which is no error.
"""


def _scene_files() -> str:
    """The lines on class ids, which observations of part_3 may have beside their masks."""
    return (
        f"Observations of part_3 may have `{layout.SUBMISSION_CATEGORIES}/frame_000.png`, too: the class id of each "
        "marked pixel, for every test frame of part_3 or for none.\n"
    )


def terms(title: str, contact: str | None) -> str:
    """General terms, for organisers who bring none."""
    ask = f" Write to {contact} if in doubt." if contact else ""
    return f"""# Terms of {title}

1. Submit the output of a method, not masks drawn by hand. The method may not be tuned on the truth of the test frames.
2. One account for each team.
3. Use of the data is bound to their licence.
4. Results on the leaderboard are public under the name of the account. The organisers may take down a submission that
   breaks these terms.{ask}
"""


def logo() -> bytes:
    """A picture for the competition (PNG, 256 × 256): a marked object and rings of sound; always the same bytes."""
    import cv2

    picture = np.full((_SIDE, _SIDE, 3), (64, 44, 32), dtype=np.uint8)
    centre = (_SIDE * 3 // 8, _SIDE * 5 // 8)
    for radius in (72, 104, 136):
        cv2.ellipse(picture, centre, (radius, radius), 0, -75, 15, (214, 190, 120), 9, cv2.LINE_AA)
    cv2.circle(picture, centre, 42, (92, 178, 248), -1, cv2.LINE_AA)
    return bytes(cv2.imencode(".png", picture)[1].tobytes())
