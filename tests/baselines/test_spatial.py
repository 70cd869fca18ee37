"""The choice by spatial sound: free field in closed form, invariances, merging, edge cases."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avs3d_bench.contract.taxonomy import CATEGORIES
from avs3d_bench.errors import Avs3dError
from baselines.echosegnet import clusters, spatial
from baselines.echosegnet.binaural import HEAD_RADIUS, SPEED_OF_SOUND, lateral_angle, shadow_power, woodworth_itd
from baselines.echosegnet.clusters import dbscan, merge_fragments, representatives
from baselines.echosegnet.spatial import CueWeights, SpatialChoice, candidates, choose, student_fit
from generators.assets.catalogue import build_model, training_variants
from tests.support.tiers import some

SR = 44_100
PHASE, ILD, LEVEL = CueWeights(3.0, 0.0, 0.0), CueWeights(0.0, 0.03, 0.0), CueWeights(0.0, 0.0, 0.05)


@dataclass(frozen=True)
class Listener:
    name: str
    rotation: np.ndarray
    position: np.ndarray
    split: str = "train"


def looking(yaw):
    """OpenCV camera in a Y-down world, turned right by ``yaw`` radians from +Z; columns: right, down, ahead."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def walk(seed, count=12):
    """A short walk on the spot of a room; heads turn."""
    rng = np.random.default_rng(seed)
    yaw = np.cumsum(rng.uniform(-1, 1, count)) + rng.uniform(0, 6)
    place = np.stack([rng.uniform(-1.5, 1.5, count), np.full(count, -1.5), rng.uniform(-1.5, 1.5, count)], axis=1)
    return [Listener(f"frame_{i:03d}", looking(yaw[i]), place[i]) for i in range(count)]


def free_field(source, listeners, *, seed=0, fluctuation=0.0, scale=1.0, samples=8192):
    """Clips of white noise at ``source`` (3,): Woodworth's delay × ``scale``, Brown and Duda's shadow, 1/r."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(samples, 1 / SR)
    out = []
    for listener in listeners:
        offset = source - listener.position
        lateral = lateral_angle(offset @ listener.rotation)
        spectrum = np.fft.rfft(rng.standard_normal(samples)) * 10 ** (rng.normal(0, fluctuation) / 20)
        ears = []
        for sign in (-1, 1):
            head = np.sqrt(shadow_power(frequency, np.pi / 2 - sign * lateral))
            lag = -sign * scale * woodworth_itd(lateral) / 2
            ears.append(np.fft.irfft(spectrum * head * np.exp(-2j * np.pi * frequency * lag), samples))
        out.append(np.stack(ears) * 0.1 / np.linalg.norm(offset))
    return np.stack(out).astype(np.float32)


def blobs(*centres, count=40, size=0.05, seed=0):
    """Points round each centre and their labels; every blob has the same shape."""
    shape = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    return np.concatenate([np.asarray(c, float) + shape for c in centres]), np.repeat(np.arange(len(centres)), count)


SPOTS = np.array([[2.0, -0.9, 1.0], [-1.8, -0.5, 2.0], [0.3, -1.0, -2.5], [2.5, -0.4, -1.5]])


@pytest.mark.parametrize("weights", [CueWeights(), PHASE, ILD, LEVEL], ids=["all", "phase", "ild", "level"])
@pytest.mark.parametrize("sounding", some(range(4), every=4))
def test_in_the_free_field_the_right_instance_is_chosen(sounding, weights):
    points, labels = blobs(*SPOTS)
    for seed in range(3):
        listeners = walk(seed, 16)
        choice = choose(points, labels, listeners, free_field(SPOTS[sounding], listeners, seed=seed), weights=weights)
        assert choice.best == sounding
        assert (choice.chosen == (labels == sounding)).all()


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.floats(0, 2 * np.pi))
def test_twins_half_a_metre_apart_are_told_apart_in_the_free_field(seed, angle):
    source = np.array([2.0, -1.0, 1.5])
    points, labels = blobs(source, source + 0.5 * np.array([np.cos(angle), 0, np.sin(angle)]))
    listeners = walk(seed, 16)
    assert choose(points, labels, listeners, free_field(source, listeners, seed=seed)).best == 0


@pytest.mark.parametrize("weights", [PHASE, ILD], ids=["phase", "ild"])
def test_left_and_right(weights):
    listeners = [Listener("frame_000", looking(0.0), np.zeros(3))]
    points, labels = blobs([-1.0, 0, 1.0], [1.0, 0, 1.0])
    for sounding, centre in enumerate(([-1.0, 0, 1.0], [1.0, 0, 1.0])):
        assert (
            choose(points, labels, listeners, free_field(np.array(centre), listeners), weights=weights).best == sounding
        )


def is_undecided(choice: SpatialChoice) -> bool:
    """Whether no cluster has a posterior of .9."""
    return choice.best < 0 or bool(choice.posterior[choice.best] < 0.9)


def test_front_and_back_are_undecided_from_one_pose_and_settled_by_turning():
    front, back = np.array([1.0, 0.0, 1.0]), np.array([1.0, 0.0, -1.0])
    points = np.concatenate([front + np.zeros((20, 3)), back + np.zeros((20, 3))])
    labels = np.repeat([0, 1], 20)
    still = [Listener("frame_000", looking(0.0), np.zeros(3))]
    for source, right in ((front, 0), (back, 1)):
        choice = choose(points, labels, still, free_field(source, still))
        assert choice.posterior == pytest.approx([0.5, 0.5], abs=1e-6)
        assert is_undecided(choice)
        turning = [Listener(f"frame_{i:03d}", looking(yaw), np.zeros(3)) for i, yaw in enumerate((0.0, 0.6, 1.2, 1.8))]
        choice = choose(points, labels, turning, free_field(source, turning))
        assert choice.best == right
        assert not is_undecided(choice)


def test_a_mirrored_world_gives_the_mirrored_answer():
    listeners = walk(3)
    points, labels = blobs(*SPOTS)
    clips = free_field(SPOTS[2], listeners)
    mirror = np.diag([-1.0, 1.0, 1.0])
    # Mirrored cameras have their right axis mirrored once more to stay right-handed; ears are swapped.
    mirrored = [Listener(x.name, mirror @ x.rotation @ mirror, mirror @ x.position) for x in listeners]
    one, other = choose(points, labels, listeners, clips), choose(points @ mirror, labels, mirrored, clips[:, ::-1])
    np.testing.assert_allclose(other.scores, one.scores, rtol=1e-6)
    # With the ears as they were, the same sound points elsewhere.
    assert choose(points @ mirror, labels, mirrored, clips).scores[2] < one.scores[2] - 3


def test_the_order_of_frames_points_and_clusters_changes_nothing():
    rng = np.random.default_rng(5)
    listeners = walk(4)
    points, labels = blobs(*SPOTS)
    clips = free_field(SPOTS[1], listeners, fluctuation=3.0)
    one = choose(points, labels, listeners, clips)
    frames, order, names = rng.permutation(len(listeners)), rng.permutation(len(points)), np.array([7, 3, 30, 4])
    other = choose(points[order], names[labels[order]], [listeners[i] for i in frames], clips[frames])
    assert (other.chosen == one.chosen[order]).all()
    back = np.argsort(names)
    assert other.labels.tolist() == sorted(names.tolist())
    assert (other.scores == one.scores[back]).all()
    assert other.head_scale == one.head_scale


def test_the_world_may_be_turned_and_moved():
    listeners = walk(6)
    points, labels = blobs(*SPOTS)
    clips = free_field(SPOTS[3], listeners)
    turn, shift = looking(1.1), np.array([3.0, -1.0, 7.0])
    moved = [Listener(x.name, turn @ x.rotation, turn @ x.position + shift) for x in listeners]
    one, other = choose(points, labels, listeners, clips), choose(points @ turn.T + shift, labels, moved, clips)
    np.testing.assert_allclose(other.posterior, one.posterior, atol=1e-3)


@pytest.mark.parametrize("scale", [0.75, 0.9, 1.05])
def test_the_head_scale_is_recovered(scale):
    listeners = walk(7, 24)
    points, labels = blobs(*SPOTS[:2], size=0.01)
    choice = choose(points, labels, listeners, free_field(SPOTS[0], listeners, scale=scale))
    assert choice.best == 0
    assert choice.head_scale == pytest.approx(scale, abs=0.08)


@pytest.mark.parametrize("gain", [0.2, 0.45, 1.0])
def test_the_gain_of_compressed_level_differences_is_recovered_in_spite_of_outliers(gain):
    rng = np.random.default_rng(1)
    predicted = rng.uniform(-12, 12, (1, 100))
    observed = gain * predicted[0] + rng.normal(0, 0.5, 100)
    observed[:10] = 15.0
    assert student_fit(observed, predicted, largest=1.5)[1] == pytest.approx([gain], abs=0.05)


def test_a_gain_is_never_negative_so_that_the_wrong_side_does_not_fit():
    predicted = np.random.default_rng(1).uniform(-12, 12, (1, 100))
    likelihood, gain = student_fit(-predicted[0], np.concatenate([predicted, -predicted]), largest=1.5)
    assert gain == pytest.approx([0.0, 1.0])
    assert likelihood[1] > likelihood[0] + 100


def test_reverberation_that_halves_the_level_differences_shows_in_the_gain():
    listeners = walk(8, 24)
    points, labels = blobs(*SPOTS[:3], size=0.01)
    clips = free_field(SPOTS[0], listeners).astype(float)
    diffuse = np.random.default_rng(0).standard_normal(clips.shape) * np.sqrt(np.mean(clips**2))
    dry, wet = choose(points, labels, listeners, clips), choose(points, labels, listeners, clips + diffuse)
    assert wet.best == dry.best == 0
    assert dry.ild_gain == pytest.approx(1.0, abs=0.1)
    assert 0.1 < wet.ild_gain < 0.8
    assert wet.concentration < dry.concentration


def test_a_fluctuating_source_is_not_taken_for_one_that_moves_away():
    """Loudness of the clips' own says little: the wrong place is never sure of itself."""
    points, labels = blobs(*SPOTS)
    for seed in range(5):
        listeners = walk(seed, 16)
        clips = free_field(SPOTS[0], listeners, seed=seed, fluctuation=8.0)
        choice = choose(points, labels, listeners, clips, weights=LEVEL)
        assert choice.best == 0 or is_undecided(choice)
        assert choose(points, labels, listeners, clips).best == 0


def test_silent_clips_are_passed_over():
    listeners = walk(9, 10)
    points, labels = blobs(*SPOTS)
    clips = free_field(SPOTS[2], listeners)
    clips[::2] = 0.0
    choice = choose(points, labels, listeners, clips)
    assert (choice.best, choice.heard) == (2, 5)
    alone = choose(points, labels, listeners[1::2], clips[1::2])
    np.testing.assert_allclose(choice.posterior, alone.posterior, atol=1e-9)


def test_without_any_sound_the_choice_is_open():
    points, labels = blobs(*SPOTS)
    choice = choose(points, labels, walk(0, 5), np.zeros((5, 2, 8192), np.float32))
    assert choice.posterior == pytest.approx([0.25] * 4)
    assert is_undecided(choice)
    assert (choice.heard, np.isnan(choice.head_scale)) == (0, True)


def test_size_settles_what_sound_cannot():
    points = np.concatenate([SPOTS[0] + np.zeros((90, 3)), SPOTS[1] + np.zeros((10, 3))])
    labels = np.repeat([0, 1], [90, 10])
    assert choose(points, labels, walk(0, 5), np.zeros((5, 2, 8192))).posterior == pytest.approx([0.9, 0.1])
    listeners = walk(1)  # but a hundredth of the points does not lose to the sound
    points = np.concatenate([SPOTS[0] + np.zeros((990, 3)), SPOTS[1] + np.zeros((10, 3))])
    labels = np.repeat([0, 1], [990, 10])
    assert choose(points, labels, listeners, free_field(SPOTS[1], listeners)).best == 1


def test_weights_of_nothing_leave_the_prior():
    """Without any cue the posterior is a cluster's share of the points."""
    large, small = blobs(SPOTS[0], count=30)[0], blobs(SPOTS[1], count=10)[0]
    points, labels = np.concatenate([large, small]), np.repeat([0, 1], [30, 10])
    listeners = walk(0)
    clips = free_field(SPOTS[1], listeners)
    choice = choose(points, labels, listeners, clips, weights=CueWeights(0.0, 0.0, 0.0))
    assert choice.posterior == pytest.approx([0.75, 0.25])
    assert choose(points, labels, listeners, clips).posterior[1] > 0.9


def test_one_cluster_is_the_answer():
    points, labels = blobs(SPOTS[0])
    choice = choose(points, labels, walk(0, 3), np.zeros((3, 2, 8192)))
    assert choice.chosen.all()
    assert choice.posterior == pytest.approx([1.0])
    assert not is_undecided(choice)


@pytest.mark.parametrize("labels", [np.full(5, -1), np.zeros(0, int)])
def test_no_cluster_no_choice(labels):
    choice = choose(np.zeros((len(labels), 3)), labels, walk(0, 3), np.zeros((3, 2, 8192)))
    assert (choice.best, len(choice.scores), int(choice.chosen.sum()), is_undecided(choice)) == (-1, 0, 0, True)


def test_noise_is_never_chosen():
    listeners = walk(2)
    points, labels = blobs(*SPOTS)
    labels[labels == 1] = -1
    choice = choose(points, labels, listeners, free_field(SPOTS[1], listeners))
    assert choice.labels.tolist() == [0, 2, 3]
    assert not choice.chosen[labels == -1].any()


def test_what_is_not_finite_or_not_train_is_refused_in_one_line():
    points, labels = blobs(*SPOTS)
    listeners, clips = walk(0, 3), np.zeros((3, 2, 8192))
    bad_points, bad_clips = points.copy(), clips.copy()
    bad_points[3, 1] = bad_clips[1, 0, 5] = np.nan
    lost = [*listeners[:2], Listener("frame_002", looking(0.0), np.array([0, np.nan, 0]))]
    test = [*listeners[:2], Listener("frame_002", looking(0.0), np.zeros(3), "test")]
    for arguments, message in (
        ((bad_points, labels, listeners, clips), "1 of 160 are NaN"),
        ((points, labels, listeners, bad_clips), "clip 1 holds NaN"),
        ((points, labels, lost, clips), "frame_002: its pose is NaN"),
        ((points, labels, test, clips), "frame_002: a test view"),
        ((points, labels[:-1], listeners, clips), "one whole number for each"),
        ((points, labels + 0.5, listeners, clips), "one whole number for each"),
        ((points, labels, listeners, clips[:2]), "3 views and 2 clips"),
        ((points[:, :2], labels, listeners, clips), "expected \\(N, 3\\)"),
    ):
        with pytest.raises(Avs3dError, match=message) as caught:
            choose(*arguments)
        assert "\n" not in str(caught.value)
    with pytest.raises(Avs3dError, match="finite numbers from 0 on"):
        CueWeights(ild=-1.0)


def test_fragments_are_merged_and_objects_are_not():
    rng = np.random.default_rng(0)
    body, handle = rng.uniform(0, 0.3, (300, 3)), rng.uniform(0, 0.1, (30, 3)) + [0.4, 0.1, 0.1]
    twin = np.concatenate([body, handle]) + [0.0, 0.0, 1.0]
    points = np.concatenate([body, handle, twin])
    labels = np.repeat([0, 1, 2, 3], [300, 30, 300, 30])
    merged = merge_fragments(points, labels, gap=0.12)
    assert len(np.unique(merged)) == 2
    assert (merged[:330] == merged[0]).all()
    assert (merged[330:] == merged[330]).all()
    assert len(np.unique(merge_fragments(points, labels, gap=0.01))) == 4
    assert (merge_fragments(points, labels, gap=0.0) == clusters.ranked(points, labels)).all()


def test_a_chain_of_fragments_is_one_object_up_to_the_largest_size():
    points = np.stack([np.arange(20) * 0.1, np.zeros(20), np.zeros(20)], axis=1)
    labels = np.arange(20)
    assert len(np.unique(merge_fragments(points, labels, gap=0.11, largest=5.0))) == 1
    merged = merge_fragments(points, labels, gap=0.11, largest=1.0)
    assert all(np.ptp(points[merged == k, 0]) <= 1.0 for k in np.unique(merged))
    assert len(np.unique(merged)) >= 2


def box(low, size):
    """Points 2.5 cm apart in a box: (N, 3)."""
    axes = [np.arange(0, length + 1e-9, 0.025) for length in size]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + low


MICROWAVE, COFFEE_MACHINE, VACUUM_CLEANER = (
    1 + CATEGORIES.index(name) for name in ("microwave", "coffee_machine", "vacuum_cleaner")
)


def test_what_a_network_marks_is_no_larger_than_its_category():
    """An oven 8 cm beside a microwave, marked as one: all together 1.2 m."""
    one = box((0, 0, 0), (0.5, 0.3, 0.35))
    points = np.concatenate([one, one + (0.58, 0, 0)])
    assert set(candidates(points)) == {0}
    found = clusters.marked_candidates(points, np.full(len(points), MICROWAVE))
    assert found.tolist() == np.repeat([0, 1], len(one)).tolist()
    # A vacuum cleaner may be so large.
    assert set(clusters.marked_candidates(points, np.full(len(points), VACUUM_CLEANER))) == {0}


def test_fragments_that_a_network_marks_may_lie_farther_apart():
    points = np.concatenate([box((0, 0, 0), (0.3, 0.2, 0.3)), box((0, 0.45, 0), (0.2, 0.2, 0.2))])
    assert set(candidates(points)) == {0, 1}
    assert set(clusters.marked_candidates(points, np.full(len(points), VACUUM_CLEANER))) == {0}


def test_each_category_has_its_own_candidates():
    large, small = box((0, 0, 0), (0.5, 0.3, 0.35)), box((0.53, 0, 0), (0.2, 0.3, 0.2))
    points, sizes = np.concatenate([large, small]), [len(large), len(small)]
    assert set(candidates(points)) == {0}
    found = clusters.marked_candidates(points, np.repeat([MICROWAVE, COFFEE_MACHINE], sizes))
    assert found.tolist() == np.repeat([0, 1], sizes).tolist()
    # Twelve stray points of another class are no candidate beside many more.
    stray = np.concatenate([box((0, 0, 0), (1.0, 0.3, 0.4)), box((3, 0, 0), (0.05, 0.05, 0.025))])
    few = np.arange(len(stray)) >= len(stray) - 18
    assert set(clusters.marked_candidates(stray, np.where(few, COFFEE_MACHINE, MICROWAVE))[few]) == {-1}
    # Points of no class are no candidates; an object of a category of the manifest's own may be as large as any.
    assert clusters.marked_candidates(points, np.repeat([0, 200], sizes)).tolist() == np.repeat([-1, 0], sizes).tolist()
    assert clusters.largest_of(200) == clusters.LARGEST
    assert clusters.marked_candidates(np.zeros((0, 3)), np.zeros(0, np.int64)).shape == (0,)


@pytest.mark.parametrize("category", some(CATEGORIES, every=3))
def test_no_model_for_training_is_larger_than_its_category(category):
    """At any turn about the vertical axis, as boxes of candidates lie along the axes."""
    largest = clusters.largest_of(1 + CATEGORIES.index(category))
    sizes = [
        build_model(category, name, np.random.default_rng(seed)).size
        for name in training_variants(category)
        for seed in range(3)
    ]
    assert max(np.hypot(np.sqrt(2) * np.hypot(x, z), y) for x, y, z in sizes) <= largest
    assert max(np.linalg.norm(size) for size in sizes) >= largest / 2


def test_noise_joins_the_only_cluster_in_reach():
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [0.1, 0, 0], [0.5, 0, 0]])
    assert merge_fragments(points, np.array([0, 1, -1, -1]), gap=0.2).tolist() == [0, 1, 0, -1]
    # Between two that are too large together it stays noise.
    assert merge_fragments(points, np.array([0, 1, -1, -1]), gap=0.6, largest=0.5).tolist() == [0, 1, 0, -1]


@settings(max_examples=25)
@given(st.integers(0, 10**6))
def test_merging_and_clustering_do_not_depend_on_the_order(seed):
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(c, 0.05, (30, 3)) for c in rng.uniform(-0.5, 0.5, (5, 3))])
    order = rng.permutation(len(points))
    assert (candidates(points[order]) == candidates(points)[order]).all()
    labels = rng.integers(-1, 6, len(points))
    names = rng.permutation(6) + 10
    named = np.where(labels[order] < 0, -1, names[labels[order]])
    assert (merge_fragments(points[order], named, gap=0.1) == merge_fragments(points, labels, gap=0.1)[order]).all()


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.floats(0.01, 0.3))
def test_after_merging_no_two_clusters_are_within_the_gap(seed, gap):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 0.5, (60, 3))
    labels = rng.integers(0, 8, 60)
    merged = merge_fragments(points, labels, gap=gap, largest=10.0)
    for k in np.unique(labels):
        assert len(np.unique(merged[labels == k])) == 1  # what was one stays one
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert (distance[merged[:, None] != merged[None]] > gap).all()


def test_candidates_are_the_objects_without_their_crumbs():
    rng = np.random.default_rng(3)
    first, second = rng.uniform(0, 0.3, (2000, 3)), rng.uniform(0, 0.3, (1500, 3)) + [1.0, 0, 0]
    crumb = rng.normal(0, 0.005, (8, 3)) + [3.0, 0, 0]
    labels = candidates(np.concatenate([first, second, crumb]))
    assert (labels[:2000] == 0).all()
    assert (labels[2000:3500] == 1).all()
    assert (labels[3500:] == -1).all()
    assert candidates(np.zeros((0, 3))).shape == (0,)
    assert (candidates(rng.uniform(0, 50, (20, 3))) == -1).all()


def test_dbscan_finds_what_scikit_learn_finds():
    sklearn = pytest.importorskip("sklearn.cluster")
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.normal(c, 0.03, (80, 3)) for c in rng.uniform(-0.4, 0.4, (6, 3))])
    ours, theirs = dbscan(points), sklearn.DBSCAN(eps=0.04, min_samples=6).fit(points)
    core = theirs.core_sample_indices_
    assert ((ours < 0) == (theirs.labels_ < 0)).all()
    pairs = {(a, b) for a, b in zip(ours[core], theirs.labels_[core], strict=True)}
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def test_representatives_span_the_cluster_and_pass_over_strays():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-1, 1, (500, 3)), [[50.0, 0, 0]]])
    some = representatives(points, 12)
    assert some.shape == (12, 3)
    assert np.abs(some).max() <= 1.0
    assert (np.ptp(some, axis=0) > 1.2).all()
    assert representatives(np.zeros((7, 3))).tolist() == [[0.0, 0.0, 0.0]]


def test_constants_are_those_of_the_papers():
    assert (HEAD_RADIUS, SPEED_OF_SOUND) == (0.0875, 343.0)
    assert 1.0 in spatial.HEAD_SCALES
