"""OWOD-BIND: open-world boxes, their masks, and the ones of them that match the sound. A 2D baseline, training-free.

For every frame on its own, from its picture and its two-second mono clip (`run.OwodBind`):

1. `boxes` proposes class-agnostic boxes; the first of them stays, and those with a score > 0.15 and both sides < 0.98
   of the image's height.
2. `masks` turns every box into one mask (SAM).
3. `select` cuts the masked objects out, everything outside the mask blurred.
4. `similarity` compares each cut-out with the clip.
5. `select` keeps the masks whose softmax over the frame's proposals is > 0.2, and joins them; of none the union is an
   empty mask.

A frame without any detection gets no file from the released code. Here it gets an empty mask: a submission has a mask
for every test frame, and in a folder of train masks a file says that the frame is done, so that a second run goes on
after it. `echosegnet` takes a missing file for an empty mask as well (`sources.FolderMasks`).

The three networks implement the protocols of `protocols`; their weights are local folders (see
`baselines.networks.checkpoints`). Nothing of a frame's truth is read. The masks of test frames are a submission, those
of train frames are what EchoSegnet lifts into 3D.

Reference: "3D Audio-Visual Segmentation", Sokolov, Bhosale, Zhu, 2024, section 4; and its released code.

Examples:
    >>> from avs3d_bench import Dataset
    >>> from baselines import owod_bind
    >>> model = owod_bind.load_owod_bind(
    ...     boxes_checkpoint="weights/owlv2", sam_checkpoint="weights/sam",
    ...     similarity="pe-av", similarity_checkpoint="weights/pe-av", device="cpu",
    ... )
    >>> writer = owod_bind.write_owod_bind(Dataset("data/demo"), "boxes", model, only=["part_1/*"], overwrite=True)
    >>> sorted(path.name for path in writer.path.rglob("*.png"))
    ['frame_000.png', 'frame_008.png']
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
