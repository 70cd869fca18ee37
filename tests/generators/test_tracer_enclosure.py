"""A source or a listener in a closed body is refused; one in any open place is not, however narrow it is."""

import itertools

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from avs3d_bench.errors import Avs3dError
from generators import acoustics, objects
from generators.acoustics.geometry import AcousticMesh, acoustic_mesh
from generators.acoustics.tracer.enclosure import closed_body
from generators.acoustics.tracer.surfaces import surfaces_of
from generators.scenes.home_scene import HomeScene
from tests.support.flats import plain_flat

SIZE = np.array([6.0, 2.7, 4.0])
LISTENER = (5.0, 1.5, 3.5)
FEW = acoustics.TraceSettings(arrivals=100, least_rays=100, most_rays=100, rain_rays=10, early_order=1)


def block(low, high, without=None):
    """A box between two corners; ``without``: the direction of a face that it lacks."""
    box = trimesh.creation.box(bounds=[low, high])
    if without is not None:
        box.update_faces(box.face_normals @ np.array(without) < 0.5)
    return box


ROOM = block((0, 0, 0), SIZE)


def turned(mesh, angle):
    """The mesh turned about the vertical through its middle."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, (0, 1, 0), mesh.bounds.mean(axis=0)))
    return mesh


def tube(radius, height, at):
    """An upright tube, open at both ends."""
    mesh = trimesh.creation.cylinder(radius, height, sections=16)
    mesh.update_faces(np.abs(mesh.face_normals[:, 2]) < 0.5)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    return mesh.apply_translation(at)


def with_hole(side):
    """A cabinet of 2.36 m² with a square hole in its front: open box, and four strips before it."""
    low, high = np.array([2.7, 0.6, 0.25]), np.array([3.3, 1.4, 0.75])
    (x, y, z), half = [high[0], 1.0, 0.5], side / 2
    strips = [
        ((y + half, high[1]), (low[2], high[2])),
        ((low[1], y - half), (low[2], high[2])),
        ((y - half, y + half), (low[2], z - half)),
        ((y - half, y + half), (z + half, high[2])),
    ]
    front = [block((x - 1e-3, a[0], b[0]), (x, a[1], b[1])) for a, b in strips]
    return [block(low, high, without=(1, 0, 0)), *front]


def room_of(*meshes, materials=0.2):
    return acoustics.Room.from_mesh(trimesh.util.concatenate([ROOM, *meshes]), materials)


def body_at(meshes, point):
    scene = room_of(*meshes).scene
    return closed_body(surfaces_of(acoustic_mesh(scene, (0.0, 0.0, 0.0))), np.array(point, dtype=float))


#: What stands in the room, a point in it, and the size of the body.
BODIES = {
    "wardrobe": ([block((1, 0, 0.01), (2.8, 2, 0.61))], (2, 1, 0.3), (1.8, 2, 0.6)),
    "wardrobe without a bottom, 1 mm above the floor": (
        [block((1, 0.001, 0.01), (2.8, 2, 0.61), without=(0, -1, 0))],
        (1.02, 0.03, 0.03),
        (1.8, 2, 0.6),
    ),
    "pillar": ([block((2.7, 0, 1.7), (3.3, 2.7, 2.3))], (3.2, 1.3, 2), (0.6, 2.7, 0.6)),
    "thick wall": ([block((2.8, 0, 0), (3.2, 2.7, 4))], (3, 1.3, 2), (0.4, 2.7, 4)),
    "block of stone": ([block((2.5, 0, 1.5), (3.5, 1, 2.5))], (3, 0.5, 2), (1, 1, 1)),
    "mattress": ([block((2, 0.3, 1.2), (4, 0.5, 2.8))], (3, 0.4, 2), (2, 0.2, 1.6)),
    "outer wall": ([block((-0.4, -0.4, -0.4), SIZE + 0.4)], (-0.2, 1.3, 2), (6.8, 3.5, 4.8)),
    "ball": ([trimesh.creation.icosphere(3, 0.3).apply_translation((3, 1, 2))], (3, 1.1, 2), (0.6, 0.6, 0.6)),
    "cabinet with a hole of a thousandth of its surface": (with_hole(0.05), (3, 1, 0.5), (0.6, 0.8, 0.5)),
}


@pytest.mark.parametrize("name", BODIES)
def test_the_size_of_a_closed_body_is_found(name):
    meshes, point, size = BODIES[name]
    found = body_at(meshes, point)
    assert found is not None
    assert found.size == pytest.approx(size, rel=0.1)


def test_the_size_of_a_turned_wall_does_not_make_it_a_room():
    wall = turned(block((2.7, 0.05, 0.75), (3.3, 2.65, 3.25)), 0.6)
    assert body_at([wall], (3, 1.3, 2)) is not None
    assert body_at([wall], (1, 1.3, 2)) is None


PARTITION = block((0.87, 0, 0), (0.92, 2.7, 4))
#: What stands in the room, and a point that is in the open or in a room of its own.
OPEN = {
    "empty room": ([], (3, 1.3, 2)),
    "2 cm from a wall": ([], (0.02, 1.3, 2)),
    "1 mm from three walls": ([], (0.001, 0.001, 0.001)),
    "2 cm before a wardrobe": (BODIES["wardrobe"][0], (2, 1, 0.63)),
    "inside of an outer wall": (BODIES["outer wall"][0], (1, 1.3, 2)),
    "on a ball": (BODIES["ball"][0], (3, 1.31, 2)),
    "under a table": ([block((2, 0.7, 1.2), (4, 0.74, 2.8))], (3, 0.3, 2)),
    "under a bed, 10 cm high": ([block((2, 0.1, 1.2), (4, 0.3, 2.8))], (3, 0.05, 2)),
    "at the back of an open cupboard": (
        [block((2.75, 0.75, 0.02), (3.25, 1.25, 0.62), without=(0, 0, 1))],
        (2.77, 0.77, 0.04),
    ),
    "in a long lampshade": ([tube(0.1, 0.4, (3, 1.5, 2))], (3, 1.5, 2)),
    "in a cabinet with a hole of a fiftieth of its surface": (with_hole(0.2), (3, 1, 0.5)),
    "in the next room": ([PARTITION], (0.4, 1.3, 2)),
    "in a closed toilet": (
        [PARTITION, block((0, 0, 1.25), (0.87, 2.7, 1.3)), block((0.25, 0, 0.03), (0.65, 0.8, 0.63))],
        (0.1, 0.1, 0.3),
    ),
}


@pytest.mark.parametrize("name", OPEN)
def test_an_open_place_is_none(name):
    assert body_at(*OPEN[name]) is None


def test_a_mesh_that_is_open_has_no_closed_bodies():
    shell = trimesh.Trimesh(ROOM.vertices, ROOM.faces[:-1], process=False)
    room = acoustics.Room.from_mesh(shell, 0.2)
    surfaces = surfaces_of(acoustic_mesh(room.scene, (0.0, 0.0, 0.0)))
    assert closed_body(surfaces, np.array([1.0, 1.0, 1.0])) is None
    assert closed_body(surfaces_of(AcousticMesh(np.zeros((0, 3)), {})), np.zeros(3)) is None


def test_random_bodies_are_those_of_a_flood_fill():
    """Boxes on a grid of 10 cm: cells are joined unless a face lies between them."""
    rng = np.random.default_rng(5)
    cells = np.array([30, 24, 30])
    faces = np.zeros((*cells, 3), dtype=bool)  # whether a face lies between a cell and the next one along an axis
    meshes = [block((0, 0, 0), cells / 10)]
    for _ in range(70):
        size = rng.integers(2, 7, 3)
        low = rng.integers(0, cells - size + 1)
        high = low + size
        meshes.append(block(low / 10, high / 10))
        for axis, end in itertools.product(range(3), (low, high)):
            if 0 < end[axis] < cells[axis]:
                place = [slice(a, b) for a, b in zip(low, high, strict=True)]
                place[axis] = end[axis] - 1
                faces[(*place, axis)] = True
    number = np.arange(cells.prod()).reshape(cells)
    pairs = []
    for axis in range(3):
        first, second = np.moveaxis(number, axis, 0)[:-1], np.moveaxis(number, axis, 0)[1:]
        free = ~np.moveaxis(faces[..., axis], axis, 0)[:-1]
        pairs.append(np.stack([first[free], second[free]]))
    rows, columns = np.concatenate(pairs, axis=1)
    _, space = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), (number.size, number.size)), False)
    outside = space == np.bincount(space).argmax()
    mesh = acoustics.Room.from_mesh(trimesh.util.concatenate(meshes), 0.2)
    surfaces = surfaces_of(acoustic_mesh(mesh.scene, (0.0, 0.0, 0.0)))
    found = {True: 0, False: 0}
    for each in rng.permutation(number.size)[:150]:
        point = (np.array(np.unravel_index(each, cells)) + rng.uniform(0.1, 0.9, 3)) / 10
        is_body = closed_body(surfaces, point) is not None
        assert is_body != outside[each], point
        found[is_body] += 1
    assert min(found.values()) > 15


def response(room, source, listener):
    return acoustics.Tracer(settings=FEW).response(room, source, listener, acoustics.Omni(), sample_rate=8000)


@pytest.mark.parametrize("name", ["wardrobe", "pillar", "thick wall"])
def test_source_or_listener_in_a_body_is_one_clear_line(name):
    meshes, point, _ = BODIES[name]
    room = room_of(*meshes)
    for what, places in {"source": (point, LISTENER), "listener": (LISTENER, point)}.items():
        with pytest.raises(Avs3dError) as caught:
            response(room, *places)
        text = str(caught.value)
        place = tuple(float(c) for c in point)
        assert f"mesh: the {what} at {place} is in a wall or another closed body of " in text
        assert "move it out of the body, or, to hear " in text
        assert "\n" not in text


def test_who_is_in_the_same_body_hears():
    room = room_of(*BODIES["wardrobe"][0])
    assert response(room, (1.5, 1, 0.3), (2.5, 1, 0.3)).samples.any()
    assert response(room, (3, 1, 2), LISTENER).samples.any()


def test_a_body_whose_material_transmits_is_heard_through():
    """A loudspeaker in its cabinet: the direct sound passes the face with the material's coefficient."""
    cabinet = block((2.7, 0.6, 0.25), (3.3, 1.4, 0.75))
    tau = 0.1
    scene = trimesh.Scene({"room": ROOM, "cabinet": cabinet})
    front = {"absorption": 0.2, "scattering": 0.3, "transmission": [tau] * 6}
    room = acoustics.Room.from_mesh(scene, {"cabinet": front, "*": 0.2})
    rir = response(room, (3.0, 1.0, 0.5), (3.0, 1.0, 2.5))
    assert rir.arrivals is not None
    direct = rir.arrivals.pressure[rir.arrivals.time.argmin()]
    assert (direct[4] * rir.distance) ** 2 == pytest.approx(tau, rel=0.05)


def test_no_object_of_a_home_is_in_a_body():
    """Where the generator puts sources: in their own bodies, which are no part of what sound meets."""
    rng = np.random.default_rng(3)
    models = [
        objects.build(category, seed=rng) for category in ("microwave", "coffee_machine", "clock", "vacuum_cleaner")
    ]
    scene = HomeScene(plain_flat(1)).place(models, room="kitchen", rng=rng)
    for placed in scene.placements:
        surfaces = surfaces_of(acoustic_mesh(scene.acoustic_scene, placed.source_position))
        assert closed_body(surfaces, np.array(placed.source_position)) is None, placed.model.category
    microwave = scene.placements[0]
    whole = surfaces_of(acoustic_mesh(scene.acoustic_scene, (1e6, 1e6, 1e6)))
    assert closed_body(whole, microwave.bounds.mean(axis=0).astype(float)) is not None
