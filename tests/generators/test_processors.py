"""The bytes of a dataset do not depend on the kind of processor: BLAS kernels, and what numba compiles for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from threadpoolctl import threadpool_info

from avs3d_bench.geometry import Pose, times_matrix
from generators.core.jit import CACHE_FOLDER
from tests.support.homes import tree_digest, write_manifest

#: Kinds of processors, as OpenBLAS and numba see them: this one; one without fused multiply-add.
PROCESSORS: dict[str, dict[str, str]] = {
    "own": {},
    "old": {"OPENBLAS_CORETYPE": "Prescott", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
}
ENGINES = ("analytic", "tracer")
#: Makes a dataset with each engine, without a process for each.
GENERATE = f"""
import sys
from generators import generate
from tests.support.here import generated_here

with generated_here():
    for engine in {ENGINES}:
        generate(sys.argv[1], f"{{sys.argv[2]}}/{{engine}}", audio=engine, workers=1, extras=("depth", "rirs"))
"""


def openblas() -> bool:
    """Whether numpy's BLAS is one whose kernels can be chosen."""
    np.ones((2, 2)) @ np.ones((2, 2))
    return any(library["internal_api"] == "openblas" for library in threadpool_info())


def test_a_product_has_the_bits_of_its_written_order() -> None:
    rng = np.random.default_rng(0)
    vectors, matrix = rng.normal(size=(200, 3)), rng.normal(size=(3, 3))
    product = times_matrix(vectors, matrix)
    for vector, row in zip(vectors.tolist(), product, strict=True):
        m = matrix.tolist()
        expected = [vector[0] * m[0][k] + vector[1] * m[1][k] + vector[2] * m[2][k] for k in range(3)]
        assert row.tolist() == expected
    np.testing.assert_allclose(product, vectors @ matrix, atol=1e-14)
    assert np.array_equal(times_matrix(vectors[0], matrix), product[0])


def test_camera_and_world_coordinates_are_inverse() -> None:
    pose = Pose.from_yaw((1.0, -2.0, 0.5), 0.7, -0.3)
    points = np.random.default_rng(1).normal(size=(4, 5, 3))
    np.testing.assert_allclose(pose.to_world(pose.to_camera(points)), points, atol=1e-14)


@pytest.mark.slow
def test_a_dataset_has_the_same_bytes_on_an_older_processor(tmp_path: Path) -> None:
    """With both engines of numba, in one process for each kind of processor."""
    if sys.platform != "linux" or not openblas():
        pytest.skip("numpy's BLAS is not OpenBLAS, whose kernels OPENBLAS_CORETYPE chooses")
    manifest = write_manifest(tmp_path)
    document = yaml.safe_load(manifest.read_text())
    document["camera"] = {"size": 64, "frames": 9}
    document["observations"] = document["observations"][1:]
    manifest.write_text(yaml.safe_dump(document, sort_keys=False))
    digests = {}
    for name, variables in PROCESSORS.items():
        # numba keeps compiled code by kind of processor, what we keep of homes is not.
        caches = {"XDG_CACHE_HOME": str(tmp_path / f"cache-{name}"), "NUMBA_CACHE_DIR": str(CACHE_FOLDER)}
        environment = {key: value for key, value in os.environ.items() if key not in PROCESSORS["old"]}
        subprocess.run(
            [sys.executable, "-c", GENERATE, str(manifest), str(tmp_path / name)],
            env=environment | caches | variables, check=True, capture_output=True, timeout=600,
        )  # fmt: skip
        digests[name] = tree_digest(tmp_path / name)
    for engine in ENGINES:
        own, old = (
            {path: digest for path, digest in digests[name].items() if path.startswith(f"{engine}/")}
            for name in PROCESSORS
        )
        assert len(own) > 70
        assert own == old
