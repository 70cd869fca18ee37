"""Foundation models: a sound is named, the name is segmented, and both ears choose among what was found.

For an observation (`run.Foundation`), without any training:

1. `clap` compares the mono sound of each frame with a sentence for each category, and with sentences for other sounds
   (speech, music, a fan …): a posterior for each frame.
2. The categories that are heard become text prompts. `sam3` segments every instance of a prompt in a picture; or, where
   SAM 3's licence is not accepted, `grounded` finds boxes for the text (Grounding DINO) and a mask for each (SAM 2).
   In part_1 and part_2, what is none of the categories makes all of them candidates: an object sounds, the direction
   alone decides which. In part_3 it is silence or a sound of no class, and nothing is marked.
3. `tracks` joins the instances of different frames by their rays: what meets in one point is one object.
4. The likelihood of what both ears heard (`baselines.echosegnet.spatial`) chooses the track.

The networks implement the protocols of `protocols`; their weights are local folders (`baselines.networks.checkpoints`),
and nothing is downloaded. The pictures of the test frames, the sounds and poses of all frames are read, no truth.

References:
    Y. Wu et al., "Large-scale contrastive language-audio pretraining with feature fusion and keyword-to-caption
    augmentation", ICASSP 2023 (CLAP).
    N. Carion et al., "SAM 3: Segment Anything with Concepts", 2025.
    S. Liu et al., "Grounding DINO: Marrying DINO with grounded pre-training for open-set object detection", ECCV 2024.
    N. Ravi et al., "SAM 2: Segment anything in images and videos", 2024.

Examples:
    >>> from avs3d_bench import Dataset
    >>> from baselines import foundation
    >>> model = foundation.load_foundation(folders={"clap": "weights/clap", "sam3": "weights/sam3"}, device="cpu")
    >>> writer = foundation.write_foundation(Dataset("data/demo"), "named", model, only=["part_1/*"], overwrite=True)
    >>> sorted(path.name for path in writer.path.rglob("*.png"))
    ['frame_000.png', 'frame_008.png']
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
