"""Explicit initial states: what a state file may not hold is refused, not simulated."""

from io import BytesIO

import numpy as np
import pytest
from scenes import evaluate, finish, prepared, scene

from shear_sim.document import StudyError
from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.simulation import make_pairs
from shear_sim.models.microgel.state import listed
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.study import Job, load_study

STATE = {
    "x": np.array([1e-4, 1.5e-4, 2.0e-4]),
    "y": np.array([1e-4, 1.1e-4, 1.0e-4]),
    "radius": np.full(3, 3e-5),
    "link_i": np.array([0, 1]),
    "link_j": np.array([1, 2]),
}


def start(tmp_path, **changes):
    path = tmp_path / "state.npz"
    np.savez(path, **(STATE | changes))
    return prepared(
        MicrogelPoint(
            packing=Packing(start="file", file=path),
            model=Microgel(links=Links(cut="file")),
            shear=OscillatoryShear(pre_periods=0, periods=0.1, post_periods=0),
        )
    )


def test_links_of_a_state_file(tmp_path):
    simulation = start(tmp_path)
    assert len(simulation.links.i) == 2
    assert np.isfinite(finish(simulation)["shear_stress"]).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"link_i": np.array([0, 0]), "link_j": np.array([1, 1])}, "twice"),
        ({"link_i": np.array([0, 1]), "link_j": np.array([1, 0])}, "twice"),
        ({"link_i": np.array([0, 2]), "link_j": np.array([1, 2])}, "itself"),
        ({"link_i": np.array([0, -1]), "link_j": np.array([1, 2])}, "disc -1"),
        ({"link_i": np.array([0, 1]), "link_j": np.array([1, 3])}, "disc 3"),
        ({"contact_i": np.array([0]), "contact_j": np.array([1])}, "twice"),
        ({"x": np.array([1e-4, 1e-4, 2e-4]), "y": np.full(3, 1e-4)}, "one place"),
    ],
    ids=["twice", "reversed", "itself", "negative", "beyond", "link-and-contact", "coincident"],
)
def test_impossible_pairs_are_refused(tmp_path, changes, word):
    """A pair listed twice would act twice, and overrun the new pair list at its next renewal."""
    with pytest.raises(SimulationError, match=word):
        start(tmp_path, **changes)


def test_order_of_a_pair_does_not_matter():
    """A link given as (1, 0) is one link, not a link and a contact on top of it."""
    position = [(0.0, 0.0), (1.8, 0.3)]
    one = scene(position, 1.0, links=[(0, 1)], k=1.0, step=0.1, steps=1)
    other = scene(position, 1.0, links=[(1, 0)], k=1.0, step=0.1, steps=1)
    for s in (one, other):
        s.advance(1)
        assert len(s.pairs.i) == 1
    assert np.array_equal(evaluate(one).force, evaluate(other).force)
    pairs = listed(make_pairs(np.array([(2, 1)]), np.array([(1, -1)])))
    assert (pairs.i[0], pairs.j[0], pairs.nx[0], pairs.ny[0]) == (1, 2, -1, 1)


@pytest.mark.parametrize("speed", [1e13, -1e13])
def test_a_disc_shot_across_billions_of_cells_stops_the_run(speed):
    """Its image number does not fit any integer: go on, and it acts from outside the cell."""
    simulation = scene(
        [(100.0, 100.0), (180.0, 100.0)], 60.0, velocity=np.array([(speed, 0), (0, 0)]), k=1.0,
        periodic=True, step=1.0, steps=3,
    )  # fmt: skip
    with pytest.raises(SimulationError, match="disc 0"):
        simulation.advance(4)


def archive(**arrays):
    buffer = BytesIO()
    np.savez(buffer, **(STATE | arrays))
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b"x,y\n1e-4,1e-4\n", "has no column radius"),
        ("a.csv", b"", "is no CSV table"),
        ("a.csv", b"x,y,radius\n", "holds no disc"),
        ("a.csv", b"x,y,radius\n1e-4,1e-4,2e-4\n", "largest radius is 0.0002 m: the shorter side"),
        ("a.csv", b"x,y,radius\n100,100,20\n", "in metres, not micrometres"),
        ("a.csv", b"x,y,radius\n1e-4,1e-4,nan\n", "radius holds values that are not finite"),
        ("a.csv", b"x,y,radius\n1e-4,1e-4,-2e-5\n", "radius: every value must be positive"),
        ("a.csv", b"x,y,radius,mass\n1e-4,1e-4,2e-5,0\n", "mass: every value must be positive"),
        ("a.csv", b"x,y,radius\nhere,1e-4,2e-5\n", "x holds something that is no number"),
        ("a.csv", b"x,y,radius\n0,1e-4,2e-5\n5e-4,1e-4,2e-5\n", "discs 0 and 1 .* in one place"),
        ("a.csv", b"x,y,radius,vx\n1e-4,1e-4,2e-5,1\n", "start it as it is"),
        ("a.parquet", b"nonsense", "is no Parquet table"),
        ("a.npz", b"nonsense", "is no NumPy archive"),
        ("a.npz", archive(), "used with cut: file, and only then"),
        ("a.npz", archive(mass=np.ones(2)), "3 values of x and 2 of mass"),
        ("a.npz", archive(link_i=np.array([0.5, 1])), "link_i must hold whole numbers"),
        ("a.npz", archive(x=np.ones((3, 1))), "x has 2 dimensions"),
    ],
)
def test_a_study_whose_start_file_cannot_be_simulated_is_refused(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    study = tmp_path / "study.yaml"
    study.write_text(f"packing:\n  start: file\n  file: {name}\nmodel: {{links: {{cut: none}}}}\n")
    with pytest.raises(StudyError, match=said) as caught:
        load_study(study)
    assert len(caught.value.problems) == 1
    assert "study.yaml:" in str(caught.value)


def test_a_start_file_decides_what_discs_there_are(tmp_path):
    """No default stands in the parameters (or the id) of a job for what the file says."""
    (tmp_path / "a.csv").write_text("x,y,radius,name\n1e-4,1e-4,2e-5,first\n2e-4,1e-4,2e-5,b\n")
    study = tmp_path / "study.yaml"
    study.write_text("packing: {start: file, file: a.csv}\nmodel: {links: {cut: none}}\n")
    (job,) = load_study(study).jobs()
    assert not {"discs", "packing_fraction", "size_ratio"} & set(job.parameters["packing"])
    assert Job.from_json(job.to_json()) == job
    simulation = prepared(job.point)
    assert simulation.summary is not None
    assert len(simulation.discs.x) == 2


@pytest.mark.parametrize("sliding", ["coulomb", "reset"])
def test_a_given_link_spring_acts_in_full(tmp_path, sliding):
    """Both elongations of the historical rule start from the one that is given."""
    spring = np.array([1e-6, 0.0])
    path = tmp_path / "state.npz"
    np.savez(path, **(STATE | {"link_spring": spring}))
    simulation = prepared(
        MicrogelPoint(
            packing=Packing(start="file", file=path, equilibration={"max_steps": 0}),
            model=Microgel(links=Links(cut="file"), sliding=sliding, relative_viscosity=0.0),
            shear=OscillatoryShear(pre_periods=1, periods=1, post_periods=0),
        )
    )
    simulation.advance(1)
    d, k = simulation.discs, simulation.constants.link_kt
    distance = np.hypot(d.x[1] - d.x[0], d.y[1] - d.y[0])
    torque = k * spring[0] * d.radius[0] * distance / (d.radius[0] + d.radius[1])
    assert simulation.work.torque[0] == pytest.approx(torque, rel=1e-12)
