"""Pictures and films of a job that kept snapshots: particles, and strain and stress beside them."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures import style
from shear_sim.figures.scene import Scene, view
from shear_sim.figures.shells import is_shells
from shear_sim.models.interface import BAR, Columns, Snapshot
from shear_sim.results import ResultsError, advising, read_job
from shear_sim.snapshots import beside, clusters, read_snapshots
from shear_sim.tables import Table, write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

FloatArray = NDArray[np.float64]

WIDTH, PANEL = style.DOUBLE, 2.35  # inches: of the figure, and of the curves in it
FILM_DPI = 80
FILM_DISC = 7.0  # pixels of a disc in a film, which is drawn larger where they are smaller
FILM_LARGER = 2.0  # times at most
FILM_COLOURS = 128  # fewer make smaller files
FRAME_MS = 50  # of a film
STEEP = 20.0  # times the median: what would flatten the rest of a curve


class Kept(NamedTuple):
    """A job with its snapshots."""

    path: Path
    table: Table
    snapshots: list[Snapshot]

    @property
    def strain(self) -> FloatArray:
        """Imposed strain at each snapshot; 0 where nothing is sheared."""
        rows = [s.row for s in self.snapshots]
        strain = self.table.columns.get("strain")
        return np.zeros(len(rows)) if strain is None else np.asarray(strain[rows])

    @property
    def gradient(self) -> FloatArray:
        """Imposed deformation gradient (n, 2, 2) at each snapshot: x was at the start, F x is now.

        A lid or grips move in y alone, what their logarithmic strain says. A cell is sheared, and
        shrinks in both directions alike where it does.
        """
        first, strain = self.snapshots[0], self.strain
        made = np.tile(np.eye(2), (len(strain), 1, 1))
        kind = self.table.summary["protocol"]["kind"]
        if kind in {"compaction", "tension"}:
            made[:, 1, 1] = np.exp(-strain if kind == "compaction" else strain)
        else:
            made[:, 0, 1] = strain
        if first.periodic:
            made *= np.array([s.height / first.height for s in self.snapshots])[:, None, None]
        return made


def read_kept(path: Path) -> Kept:
    """Read a job and its snapshots.

    Parameters
    ----------
    path : Path
        Result file, in ``jobs/``.

    Raises
    ------
    ResultsError
        If the job has kept none; says what to do.
    TableError
        If a file is damaged.
    """
    if path.suffix != ".parquet":
        what = (
            "a job that failed: there is nothing to draw"
            if path.suffix == ".json"
            else f"no result of a job: give its id, {path.stem}, or its file in jobs/"
        )
        msg = f"{path}: {what}"
        raise ResultsError(msg)
    table = read_job(path)
    if "snapshots" not in table.summary:
        msg = (
            f"{path}: has kept no snapshots: add `record: {{snapshots: 20}}` (so many in a period, "
            "or in a strain of 1) to its study, and sweep again; that makes it another job, which "
            "runs anew"
        )
        raise ResultsError(msg)
    with advising(path):
        snapshots = read_snapshots(beside(path), path.stem)
    return Kept(path, table, snapshots)


def nearest(kept: Kept, time: float) -> int:
    """Return the number of the snapshot that was made nearest to ``time`` [s].

    Raises
    ------
    ResultsError
        If that is not within the run.
    """
    made = kept.table.columns["time"]
    first, last = float(made[0]), float(made[-1])
    margin = 1e-4 * (last - first)  # times are read, and copied, with four digits
    if not first - margin <= time <= last + margin:  # not a number is nowhere
        msg = f"{kept.path}: no time {time:g} s: the run is from {first:.4g} to {last:.4g} s"
        if (period := kept.table.summary["protocol"].get("period")) is not None:
            msg += f", a period of it {period:.4g} s"
        raise ResultsError(msg)
    return int(np.abs(made[[s.row for s in kept.snapshots]] - time).argmin())


def moment(kept: Kept, number: int) -> str:
    """Return when a snapshot was made, as the axes of its picture say it too."""
    time = float(kept.table.columns["time"][kept.snapshots[number].row])
    protocol = kept.table.summary["protocol"]
    said = f"t = {time:.4g} s"
    if "period" in protocol:
        said += f", t / period = {(time - protocol['shear_start']) / protocol['period']:.4g}"
    return said


def write_picture(
    kept: Kept, path: Path, number: int = -1, colour: str = "particle", contacts: str | None = None
) -> str:
    """Write the picture of one snapshot, a PNG or PDF by its name.

    Its colours and widths are scaled by this snapshot alone.

    Parameters
    ----------
    kept : Kept
    path : Path
        Ends with ``.png`` or ``.pdf``.
    number : int
        Of the snapshot, from 0; from −1 on backwards.
    colour, contacts : str
        See :class:`shear_sim.figures.scene.Scene`.

    Returns
    -------
    str
        Which snapshot it shows, and when that was made.

    Raises
    ------
    ResultsError
        If there is no snapshot of this number, nothing that ``colour`` means, or no way to write
        a file there.
    OSError
        If the file cannot be written; what was there before stays.
    """
    count = len(kept.snapshots)
    if not -count <= number < count:
        msg = f"{kept.path}: no snapshot {number}: there are {count}, from 0 to {count - 1}"
        raise ResultsError(msg)
    _check_colour(kept, colour)
    with _stage(kept, colour, contacts, number % count) as stage:
        stage.show(number % count)
        with _naming(path):
            style.save_as(stage.figure, path)
    return f"snapshot {number % count}, {moment(kept, number)}"


def write_film(
    kept: Kept, path: Path, colour: str = "particle", contacts: str | None = None
) -> str:
    """Write all snapshots as an animated GIF, one frame each; see `write_picture`.

    Returns
    -------
    str
        How many there are.

    Raises
    ------
    ResultsError
        If there is nothing that ``colour`` means, or no way to write a file there.
    OSError
        If the file cannot be written; what was there before stays.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    _check_colour(kept, colour)
    with _stage(kept, colour, contacts) as stage:
        larger = FILM_DISC * 72 / (FILM_DPI * stage.scene.diameter)
        stage.figure.set_dpi(FILM_DPI * min(max(larger, 1.0), FILM_LARGER))
        canvas = FigureCanvasAgg(stage.figure)
        moving = (*stage.scene.artists, *stage.points)
        for artist in moving:
            artist.set_animated(True)
        canvas.draw()  # type: ignore[no-untyped-call]
        still = canvas.copy_from_bbox(stage.figure.bbox)  # type: ignore[no-untyped-call]
        frames = []
        for number in range(len(kept.snapshots)):
            stage.show(number)
            canvas.restore_region(still)  # type: ignore[no-untyped-call]
            for artist in moving:
                assert artist.axes is not None  # noqa: S101 - it was added to one
                artist.axes.draw_artist(artist)
            drawn = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
            frames.append(Image.fromarray(drawn[..., :3].copy()))
    # From a few of them: what changes from frame to frame are particles only.
    colours = style.palette(frames[:: max(1, len(frames) // 4)], FILM_COLOURS)
    first, *rest = (f.quantize(palette=colours, dither=Image.Dither.NONE) for f in frames)
    film = BytesIO()
    first.save(film, "gif", save_all=True, append_images=rest, duration=FRAME_MS, loop=0)
    with _naming(path):
        write_whole(path, film.getvalue())
    return f"{len(frames)} snapshots"


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the file that cannot be written."""
    try:
        yield
    except (FileNotFoundError, PermissionError) as error:
        msg = f"{path}: cannot be written there ({error.strerror}): another --out"
        raise ResultsError(msg) from error
    except OSError as error:
        msg = f"{path}: cannot be written ({error.strerror or error})"
        raise OSError(msg) from error


def _check_colour(kept: Kept, colour: str) -> None:
    first = kept.snapshots[0]
    if colour == "energy" and first.energy is None:
        msg = (
            f"{kept.path}: has kept no energies of its particles, which only soft ones do: another "
            "--colour"
        )
        raise ResultsError(msg)
    if colour == "displacement" and (first.kind == BAR).any() and np.ptp(clusters(first)) == 0:
        msg = f"{kept.path}: a single body, beside which nothing is displaced: another --colour"
        raise ResultsError(msg)
    turns = is_shells(first) or any(s.spin.any() for s in kept.snapshots)
    if colour == "spin" and not turns:
        msg = (
            f"{kept.path}: nothing turns its particles, as in the model hard_disc, or without "
            "friction: another --colour"
        )
        raise ResultsError(msg)


class _Stage:
    """A figure with a scene, and curves with a point that moves."""

    def __init__(
        self, kept: Kept, colour: str, contacts: str | None, only: int | None, figure: "Figure"
    ) -> None:
        self.kept, self.figure = kept, figure
        across, down = (float(a) for a in figure.get_size_inches())
        room = across - PANEL
        axis = figure.add_axes((0.0, 0.0, room / across, 1.0))
        self.scene = Scene(axis, kept.snapshots, kept.gradient, colour, contacts, only)
        show_weight(kept, self.scene)
        left, wide = (room + 0.7) / across, (PANEL - 0.82) / across
        curves, label = _curves(kept)
        foot, top, gap = 2.0 if self.scene.colours.scaled else 1.3, 0.16, 0.16
        each = (down - foot - top - gap * (len(curves) - 1)) / len(curves)
        each = min(each, 1.6)
        self.points: list[Line2D] = []
        self._x, self._y = label[1], []
        for place, (values, name) in enumerate(curves):
            bottom = down - top - (place + 1) * each - place * gap
            axis = figure.add_axes((left, bottom / down, wide, each / down))
            axis.plot(label[1], values, color=style.GREY, linewidth=0.8)
            _bring_near(axis, values)
            axis.set_ylabel(name)
            middle = (bottom + each / 2) / down
            axis.yaxis.set_label_coords((room + 0.22) / across, middle, figure.transFigure)
            axis.tick_params(labelbottom=place == len(curves) - 1)
            if place == len(curves) - 1:
                axis.set_xlabel(label[0])
            self.points += axis.plot(
                [], [], "o", color=style.UNORDERED[1], markersize=5, zorder=5, clip_on=False
            )
            self._y.append(values)
        low = figure.add_axes((left, 0.12 / down, wide, 0.6 / down))
        low.set_axis_off()
        self.scene.legend(low)
        if self.scene.colours.scaled:
            bar = figure.add_axes((left, 1.34 / down, wide, 0.1 / down))
            bar.set_label("<colorbar>")
            self.scene.colours.bar(bar, unit(kept, colour))

    def show(self, number: int) -> None:
        self.scene.show(number)
        row = self.kept.snapshots[number].row
        for point, values in zip(self.points, self._y, strict=True):
            point.set_data([self._x[row]], [values[row]])


def _bring_near(axis: "Axes", values: FloatArray) -> None:
    """Make an axis logarithmic where the largest of its values would leave nothing of the others.

    As where discs jam. It is linear up to what is usual.
    """
    size = np.abs(values[values != 0])
    if len(size) and size.max() > STEEP * (usual := float(np.median(size))):
        axis.set_yscale("symlog", linthresh=10.0 ** np.ceil(np.log10(usual)))


@contextmanager
def _stage(
    kept: Kept, colour: str, contacts: str | None, only: int | None = None
) -> Iterator[_Stage]:
    first = kept.snapshots[0]
    *_, width, height = view(kept.snapshots if only is None else [kept.snapshots[only]])
    shape = height / width
    high = min(max((WIDTH - PANEL) * shape, 3.2), 6.0)
    wide = min(WIDTH, PANEL + high / shape) if first.periodic else WIDTH
    with style.figure(wide, high) as figure:
        figure.set_layout_engine("none")
        yield _Stage(kept, colour, contacts, only, figure)


def _curves(kept: Kept) -> tuple[list[tuple[FloatArray, str]], tuple[str, FloatArray]]:
    """Return what is drawn beside the particles, (values, label) each, and against what."""
    columns, protocol = kept.table.columns, kept.table.summary["protocol"]
    if "deflection_ratio" in columns:
        bent = (columns["deflection_ratio"], "deflection / beam theory")
        return [bent], ("time [s]", columns["time"])
    if "ovality" in columns:
        oval = [(columns["ovality"], "ovality a/R")]
        if "outer_pressure_ratio" in columns:
            return oval, ("pressure $p R^3/EI$", columns["outer_pressure_ratio"])
        return oval, ("time [s]", columns["time"])
    if "force" in columns:
        return [(columns["force"], "force on a plate [N/m]")], (
            "compression",
            columns["compression"],
        )
    strain = columns["strain"]
    if protocol["kind"] == "tension":
        pull = (-columns["stress_yy"], "tensile stress [Pa]")
        return [pull, (columns["links_broken"], "links broken")], ("strain", strain)
    stress = _first_of(
        columns,
        scaled_shear_stress="shear stress $\\sigma\\xi_0/\\dot\\gamma$",
        shear_stress="shear stress [Pa]",
        stress_yy="stress on the lid [Pa]",
    )
    if "period" in protocol:
        time = (columns["time"] - protocol["shear_start"]) / protocol["period"]
        return [(strain, "strain"), *stress], ("time / period", time)
    rate = "/\\dot\\gamma" if _strained(kept) else "\\tau"
    pressure = _first_of(
        columns, scaled_pressure=f"pressure $p\\xi_0{rate}$", pressure="pressure [Pa]"
    )
    if protocol["kind"] == "stages":  # in which the strain goes back, or stands still
        return [(strain, "strain"), *stress, *pressure], ("time [s]", columns["time"])
    if _strained(kept):
        return [*stress, *pressure], ("strain", strain)
    density = columns.get("packing_fraction")
    more = [(density, "packing fraction")] if density is not None and np.ptp(density) > 1e-9 else []
    return [*pressure, *more], ("time [s]", columns["time"])


def _strained(kept: Kept) -> bool:
    return bool(np.ptp(kept.table.columns["strain"]) > 0)


def show_weight(kept: Kept, scene: Scene) -> None:
    """Show in a scene which way things fall, where they do."""
    if kept.table.summary["protocol"]["kind"] == "body_force":
        scene.draw_weight(kept.table.summary["parameters"]["shear"]["inclination"])


def unit(kept: Kept, colour: str) -> str:
    """Return the unit of what particles are coloured by; empty where it needs none."""
    if "scaled_pressure" in kept.table.columns:  # hard discs: of their path, not of the time
        pressure = "$\\dot\\gamma/\\xi_0$" if _strained(kept) else "$1/\\xi_0\\tau$"
        units = {"speed": "λ/path", "pressure": pressure}
    else:
        units = {"pressure": "Pa", "spin": "1/s", "speed": "m/s", "energy": "J/m"}
    return units.get(colour, "")


def _first_of(columns: Columns, **labels: str) -> list[tuple[FloatArray, str]]:
    """Return the first of these columns that there is, with its label."""
    return [(columns[name], text) for name, text in labels.items() if name in columns][:1]
