"""The pictures do not reveal the sounding object: rules without sound stay at chance, and a leak would be detected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

pytest.importorskip("sklearn", reason="the trained rule needs scikit-learn (extra baselines)")
from avs3d_bench.errors import Avs3dError
from benchmarks.leaks import IN_VIEW, LIMIT, RULES, TRAINED, Seen, judge, observe, pool, survey, table
from benchmarks.unseen_homes import MANIFESTS, plans_of, sample_manifest, used_seeds
from generators.options import GenerateOptions
from generators.plan import make_plans, read_manifest
from tests.support.tiers import some

#: Of the survey: a sample, and the one that is drawn where a rule exceeds the limit on it. The 36 of a part show a rule
#: that finds the source in a share s of the observations at s·√(36·(1 − p)/p) = 6.9·s standard errors (chance p = 0.43
#: in part_2, 0.44 in part_1). The walk of version 1.x (docs/leaks.md) had s = 0.95, and a rule with
#: s = 0.7 exceeds the limit of 2.5 in 99 % of the samples. The six samples of that page tell smaller ones.
OBSERVATIONS, HOMES, SEEDS = 72, 6, (2, 3)


def planted(rule: int | None, share: float, count: int = 200) -> list[Seen]:
    """Random features; in a ``share`` of the observations, ``rule`` has its largest value at the right candidate."""
    rng = np.random.default_rng(0)
    out = []
    for number in range(count):
        features = rng.normal(size=(int(rng.integers(2, 5)), len(RULES)))
        truth = int(rng.integers(len(features)))
        if rule is not None and rng.uniform() < share:
            features[truth, rule] = features[:, rule].max() + 0.1
        out.append(Seen("part_2", f"home_{number % 10}", str(number), features, truth, np.array([0.4])))
    return out


def test_noise_is_at_chance() -> None:
    verdicts = judge(planted(None, 0.0))
    assert [v.rule for v in verdicts] == [*RULES, TRAINED]
    assert [v.rule for v in verdicts if v.leaks] == []
    assert verdicts[0].chance == pytest.approx(np.mean([1 / len(s.features) for s in planted(None, 0.0)]))


@pytest.mark.parametrize("rule", some(range(len(RULES)), every=5))
def test_each_rule_is_caught_where_it_finds_the_source_in_a_quarter_more(rule: int) -> None:
    leaks = {v.rule for v in judge(planted(rule, 0.25)) if v.leaks}
    assert RULES[rule] in leaks
    assert leaks <= {RULES[rule], TRAINED}


def test_the_trained_rule_finds_what_runs_the_other_way() -> None:
    seen = [Seen(s.part, s.home, s.key, -s.features, s.truth, s.in_view) for s in planted(0, 0.5)]
    verdicts = {v.rule: v for v in judge(seen)}
    assert verdicts[RULES[0]].deviation < -LIMIT
    assert verdicts[TRAINED].leaks


def test_the_table_has_all_samples_their_extremes_and_the_control() -> None:
    samples = [judge(planted(0, share)) for share in (0.0, 0.5)]
    document = {
        "samples": [{"rules": [vars(v) | {"deviation": v.deviation} for v in sample]} for sample in samples],
        "pooled": [vars(v) | {"deviation": v.deviation} for v in pool(samples)],
    }
    head, rows = table(document, document, "part_2")
    assert head[2] == "least and most of the 2 samples"
    assert head[1].startswith("400 observations, chance 0.")
    assert [row[0] for row in rows] == [*RULES, TRAINED]
    first, pooled = rows[0], pool(samples)[0]
    assert first[1] == first[3] == f"{pooled.accuracy:.3f} (+{pooled.deviation:.2f})"
    assert first[2].endswith(f", +{samples[1][0].deviation:.2f}")


def test_samples_together_are_judged_as_one_sample_of_all() -> None:
    first, second = planted(0, 0.25), planted(3, 0.1)[:17]
    together = {v.rule: v for v in judge([*first, *second])}
    pooled = pool([judge(first), judge(second)])
    assert [v.rule for v in pooled] == [*RULES, TRAINED]
    for v in pooled[:-1]:  # the trained rule is trained anew on each sample
        whole = together[v.rule]
        assert (v.part, v.observations) == (whole.part, whole.observations)
        assert (v.accuracy, v.chance, v.error) == pytest.approx((whole.accuracy, whole.chance, whole.error))
        assert v.deviation == pytest.approx(whole.deviation)


def test_equal_values_share_the_credit() -> None:
    same = np.zeros((2, len(RULES)))
    seen = [Seen("part_2", f"home_{n % 3}", str(n), same, n % 2, np.array([0.4])) for n in range(10)]
    verdicts = [v for v in judge(seen) if v.rule != TRAINED]
    assert all((v.accuracy, v.deviation) == (0.5, 0.0) for v in verdicts)


def test_sampled_homes_are_unseen_and_follow_from_the_seed() -> None:
    document = sample_manifest(5, 22, seed=3)
    assert sample_manifest(5, 22, seed=3) == document
    assert sample_manifest(5, 22, seed=4)["observations"] != document["observations"]
    seeds = {scan["seed"] for scan in document["scans"].values()}
    assert len(seeds) == 5
    assert used_seeds() >= {11, 12, 13, 14}
    assert not seeds & used_seeds()
    plans = plans_of(yaml.safe_load(yaml.safe_dump(document)))
    assert len(plans) == 22
    assert len({plan.spec.scan for plan in plans}) == 5
    assert {plan.spec.part for plan in plans} == {"part_1", "part_2"}
    assert all(plan.spec.silent for plan in plans if plan.spec.part == "part_1")
    assert {p.spec.part for p in plans_of(sample_manifest(3, 6, seed=1, parts=["part_2"]))} == {"part_2"}


@pytest.mark.slow
def test_rules_that_cannot_hear_stay_at_chance() -> None:
    """Several dozen rules and parts: one of them may exceed the limit by chance, but not again on other homes."""
    seen = survey(OBSERVATIONS, homes=HOMES, seed=SEEDS[0], workers=1)
    assert len(seen) >= 0.9 * OBSERVATIONS
    leaks = {(v.part, v.rule) for v in judge(seen) if v.leaks}
    if leaks:
        again = judge(survey(OBSERVATIONS, homes=HOMES, seed=SEEDS[1], workers=1))
        leaks &= {(v.part, v.rule) for v in again if v.leaks}
    assert leaks == set()
    share = np.concatenate([each.in_view for each in seen])
    assert ((share >= IN_VIEW[0]) & (share <= IN_VIEW[1])).mean() >= 0.85


def in_open_scans(seeds: range) -> list[Seen]:
    """The observations of open-scans.yaml (part_1 and part_2), arranged with other seeds.

    Skips the test where the scans are not in the store.
    """
    source = read_manifest(MANIFESTS / "open-scans.yaml")
    out = []
    for seed in seeds:
        document = replace(source, manifest=source.manifest.model_copy(update={"seed": seed}))
        try:
            plans = make_plans(document, GenerateOptions(audio="analytic", frames=48, size=48, only=("part_[12]/*",)))
        except Avs3dError as error:
            pytest.skip(str(error))
        found = [observe(plan, 48) for plan in plans]
        out += [replace(each, home=f"seed_{seed}") for each in found if each is not None]
    return out


@pytest.mark.slow
def test_rules_that_cannot_hear_stay_at_chance_in_real_scans() -> None:
    seen = in_open_scans(range(1, 7))
    assert len(seen) >= 36
    leaks = {(v.part, v.rule) for v in judge(seen) if v.leaks}
    if leaks:
        leaks &= {(v.part, v.rule) for v in judge(in_open_scans(range(11, 17))) if v.leaks}
    assert leaks == set()


@pytest.mark.slow
def test_a_walk_planned_for_the_sounding_object_alone_is_caught() -> None:
    """The negative control: the same survey with walks as they must not be."""
    seen = survey(12, homes=2, seed=1, parts=["part_2"], workers=1, biased=True)
    assert {"share of frames in view", "centrality where in view"} & {v.rule for v in judge(seen) if v.leaks}
