"""Pictures of particles: the Lees–Edwards cell with its images, contacts and forces.

Links, and contacts that hold or slide, have the colours of the manual's figure S1-1a: a link is
blue with an orange interface, an interface that holds is red, one that slides is green.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures.geometry import (
    between_shells,
    displacement,
    in_rectangle,
    interfaces,
    is_shell,
    outlines,
    particle_pressure,
    particle_tints,
    round_trips,
)
from shear_sim.looks import Colour, Contacts
from shear_sim.models.interface import CONTACT, LINK, SLIDING, Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Colormap
    from matplotlib.legend import Legend

FloatArray = NDArray[np.float64]

_FIXED, _EDGE = "#9a9a9a", "#5a6470"
_LINK, _INTERFACE, _HOLDS, _SLIDES = "#0a5fa8", "#f08c00", "#c8102e", "#00a35c"
_PUSH, _PUSH_ON_SCALE, _PULL = "#8c1016", "#20242a", "#0a5fa8"
_DIMMED = 0.62  # of white in what lies outside of the cell
_CORNERS = 36  # of a disc; half as many where it is small
_SMALL_DISC = 7.0  # points: smaller ones have no edges, and contacts are drawn as forces
_INTO_SHELL = 0.12  # of the picture: the longest line of a force on a shell
_ON_SHELL = 0.9  # points: its width
_MARGIN = 0.7  # around the cell, in largest diameters
_FULL = 98.0  # percentile that takes the end of a colour scale
_TITLES = {
    "pressure": "pressure of a particle",
    "spin": "spin",
    "speed": "speed",
    "displacement": "non-affine displacement\n[mean diameters]",
}


class Scene:
    """One panel with particles, which shows one snapshot after another.

    Parameters
    ----------
    axis : Axes
        Where to draw; its place in the figure should be settled, as lines are as thick as
        particles are large.
    snapshots : sequence of Snapshot
        Of one job: colours mean the same in all of them.
    strain : (len(snapshots),)
        Imposed strain at each.
    colour : Colour or str
        ``particle``: its cluster of links; large or small where there are none.
        ``displacement``: from the affine image of where it was in the first snapshot.
    contacts : Contacts or str, optional
        Default: what can be seen.

    Raises
    ------
    ValueError
        If one of both is no such word.
    """

    def __init__(
        self,
        axis: "Axes",
        snapshots: Sequence[Snapshot],
        strain: FloatArray,
        colour: str = "particle",
        contacts: str | None = None,
    ) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self.axis, self.snapshots, self.colour = axis, snapshots, Colour(colour)
        first = snapshots[0]
        self._shell = is_shell(first)
        self._many = self._shell and len(round_trips(first)) > 1
        self._left, self._bottom, self.width, self.height = view(snapshots)
        axis.set(xlim=(self._left, self._left + self.width))
        axis.set(ylim=(self._bottom, self._bottom + self.height))
        axis.set(aspect="equal", xticks=[], yticks=[])
        axis.grid(visible=False)
        for side in axis.spines.values():
            side.set_visible(False)
        figure = axis.get_figure(root=True)
        assert figure is not None  # noqa: S101 - an axis of a figure
        room = axis.get_position()
        across, down = (float(a) for a in figure.get_size_inches())
        inches = min(room.width * across / self.width, room.height * down / self.height)
        self.point = 72 * inches  # per unit of length
        self.diameter = 2 * self.point * float(first.radius.mean())  # [points]
        #: Too small for all forces: those above the mean are the chains.
        self._small = bool(not self._shell and self.diameter < _SMALL_DISC)
        self.contacts = Contacts(contacts or self._readable(first))
        self._tints = particle_tints(first)
        self._values = self._coloured(strain)
        self._scale = _limits(self._values, colour)
        edge = 0.0 if self.diameter < _SMALL_DISC else min(0.035 * self.diameter, 0.6)
        self._discs = PolyCollection([], linewidths=edge, edgecolors=_EDGE)
        if edge == 0.0:
            self._discs.set_edgecolor("none")
        thick = 2 * self.point * float(first.radius.mean()) if self._shell else 0.0
        self._links = LineCollection([], colors=_LINK, linewidths=thick or self._line(0.055))
        self._interfaces = LineCollection([], linewidths=self._line(0.06))
        self._forces = LineCollection([])
        self._cell = LineCollection([], colors="0.15", linewidths=0.8, linestyles="dashed")
        self._own = LineCollection([], colors="0.1", linewidths=1.1)
        self.artists = (
            self._discs, self._links, self._interfaces, self._forces, self._cell, self._own,
        )  # fmt: skip
        for order, artist in enumerate(self.artists):
            artist.set(zorder=2 + order)
            axis.add_collection(artist, autolim=False)
        for artist in (self._links, self._interfaces, self._forces):
            artist.set_capstyle("round")

    def _line(self, of_diameter: float) -> float:
        return min(max(of_diameter * self.diameter, 0.25), 2.5)

    def _readable(self, first: Snapshot) -> str:
        if self._shell or not first.periodic:
            return "force"
        if self.diameter < _SMALL_DISC and (self.colour != "particle" or LINK in first.kind):
            return "none"  # particles are seen by their colours
        held = any((s.kind != CONTACT).any() for s in self.snapshots)
        return "state" if held and self.diameter >= _SMALL_DISC else "force"

    # --- What colours mean -----------------------------------------------------------------------

    def _coloured(self, strain: FloatArray) -> list[FloatArray]:
        """Return what the particles (N,) are coloured by, snapshot by snapshot."""
        first = self.snapshots[0]
        if self.colour == "pressure":
            return [particle_pressure(s) for s in self.snapshots]
        if self.colour == "spin":
            return [s.spin for s in self.snapshots]
        if self.colour == "speed":
            return [np.hypot(*s.velocity.T) for s in self.snapshots]
        if self.colour == "displacement":
            size = 2 * float(first.radius.mean())
            return [
                np.hypot(*displacement(s, first, float(g - strain[0])).T) / size
                for s, g in zip(self.snapshots, strain, strict=True)
            ]
        return []

    def _faces(self, number: int) -> FloatArray:
        """Return the colours (N, 4) of the particles."""
        from matplotlib.colors import to_rgba_array

        snapshot = self.snapshots[number]
        if self._values:
            low, high = self._scale
            share = (self._values[number] - low) / (high - low)
            made = np.asarray(self._map(share), np.float64)
        else:
            made = to_rgba_array(self._tints)
        made[snapshot.fixed] = to_rgba_array(_FIXED)
        if self.contacts == "force" and not self._values:
            made[:, :3] = 1 - 0.55 * (1 - made[:, :3])
        return made

    @property
    def _map(self) -> "Colormap":
        """Colours of the scale, none so dark that lines on it are lost."""
        from matplotlib import colormaps
        from matplotlib.colors import ListedColormap

        name, low, high = {
            "pressure": ("YlOrBr", 0.0, 0.72), "spin": ("RdBu", 0.12, 0.88),
            "speed": ("YlGnBu", 0.0, 0.75), "displacement": ("YlGnBu", 0.0, 0.75),
        }[self.colour]  # fmt: skip
        return ListedColormap(colormaps[name](np.linspace(low, high, 256)))

    def colourbar(self, axis: "Axes", unit: str) -> None:
        """Draw the colour scale into ``axis``; nothing is drawn for particles without one."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colorbar import Colorbar
        from matplotlib.colors import Normalize

        mappable = ScalarMappable(Normalize(*self._scale), self._map)
        bar = Colorbar(axis, mappable, orientation="horizontal")
        text = _TITLES[self.colour]
        bar.set_label(text if "[" in text or not unit else f"{text} [{unit}]")
        bar.outline.set_visible(False)

    @property
    def scaled(self) -> bool:
        """Whether colours have a scale."""
        return bool(self._values)

    def legend(self, axis: "Axes") -> "Legend | None":
        """Say in ``axis`` what the lines are."""
        from matplotlib.lines import Line2D

        def line(colour: str, text: str, width: float = 2.2) -> Line2D:
            return Line2D([], [], color=colour, linewidth=width, label=text)

        kinds = set(np.concatenate([np.unique(s.kind) for s in self.snapshots]).tolist())
        shown = []
        if self.contacts == "state":
            slides = SLIDING in kinds
            shown += [line(_LINK, "link"), line(_INTERFACE, "interface of a link")] * (
                LINK in kinds
            )
            shown += [line(_HOLDS, "contact that holds")] * (CONTACT in kinds)
            shown += [line(_SLIDES, "contact that slides")] * slides
        elif self.contacts == "force":
            push = _PUSH_ON_SCALE if self._values else _PUSH
            one = self._shell and not self._many
            way = "length: force / largest" if one else "width: force / mean"
            way = "above the mean" if self._small else way
            shown += [line(push, f"push; {way}")]
            # Bars of a shell are drawn as its outline, whatever force is in them.
            pulls = ((s.normal < 0) & ~(self._shell & (s.kind == LINK)) for s in self.snapshots)
            shown += [line(_PULL, "pull")] * any(pull.any() for pull in pulls)
        if not shown:
            return None
        return axis.legend(
            handles=shown, loc="lower left", handlelength=1.2, borderpad=0, borderaxespad=0
        )

    # --- Drawing ---------------------------------------------------------------------------------

    def show(self, number: int) -> None:
        """Show snapshot ``number``."""
        from matplotlib.colors import to_rgba_array

        s = self.snapshots[number]
        place = in_rectangle(s)
        moves = self._moves(s)
        faces = self._faces(number)
        who, move = self._seen(place, moves, float(s.radius.max()))
        there = place[who] + moves[move]
        own = (there >= 0).all(axis=1) & (there < [s.width, s.height]).all(axis=1)
        own |= not s.periodic
        outline = outlines(s, _CORNERS if self.diameter >= _SMALL_DISC else _CORNERS // 2)
        order = np.argsort(own, kind="stable")  # the cell's own lie on top
        self._discs.set_verts(list(outline[who[order]] + there[order, None]))
        self._discs.set_facecolor(dimmed(faces[who], ~own)[order])  # type: ignore[arg-type]
        self._lines(s, place, moves)
        if self._shell:
            trips = round_trips(s)
            self._discs.set_verts([place[trip] for trip in trips])
            tints = faces if self._values else to_rgba_array(self._tints)
            self._discs.set_facecolor(tints[[t[0] for t in trips]])  # type: ignore[arg-type]
        self._edges(s, moves)

    def _moves(self, s: Snapshot) -> FloatArray:
        """Return the displacements (M, 2) of the images that may be seen, the cell's own first."""
        if not s.periodic:
            return np.zeros((1, 2))
        many = math.ceil((self.width + abs(s.offset)) / s.width)
        found = [
            (a * s.width + b * s.offset, b * s.height)
            for b in (0, -1, 1)
            for a in sorted(range(-many, many + 1), key=abs)
        ]
        return np.array(found)

    def _seen(
        self, place: FloatArray, moves: FloatArray, reach: float
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return which images of which points (N, 2) are within the picture, or ``reach`` of it."""
        there = place[:, None] + moves
        low = np.array([self._left, self._bottom])
        high = low + np.array([self.width, self.height])
        seen = ((there > low - reach) & (there < high + reach)).all(axis=2)
        who, move = np.nonzero(seen)
        return who, move

    def _lines(self, s: Snapshot, place: FloatArray, moves: FloatArray) -> None:
        """Draw links and interfaces, or forces."""
        from matplotlib.colors import to_rgba_array

        for collection in (self._links, self._interfaces, self._forces):
            collection.set_segments([])
        if self._shell or self.contacts == "state":
            links = s.kind == LINK
            self._segments(self._links, s, place, moves, links, to_rgba_array(_LINK))
        if self.contacts == "none":
            return
        if self.contacts == "state":
            colours = to_rgba_array([_INTERFACE, _HOLDS, _SLIDES])
            faces = interfaces(s)
            there = np.ptp(faces, axis=1).any(axis=1)
            segments = place[s.i[there], None] + faces[there]
            self._put(self._interfaces, s, segments, colours[s.kind[there]], moves)
            return
        if self._shell and self._many:
            s = between_shells(s)
            place = s.position
        strong = np.abs(s.normal)
        if self._shell:
            strong = np.where(s.kind == LINK, 0.0, strong)
        mean = float(strong[strong > 0].mean()) if (strong > 0).any() else 1.0
        size = 2 * self.point * float(s.radius.mean()) if self._many else self.diameter
        thick = np.minimum(0.1 * strong / mean, 0.4) * max(size, 3.0)
        push = _PUSH_ON_SCALE if self._values else _PUSH
        colour = to_rgba_array([push, _PULL])[(s.normal < 0).astype(int)]
        from_i = place[s.i]
        to_j = from_i + s.separation
        if self._shell and not self._many:  # thin: what presses on it reaches into it
            away = s.separation / np.hypot(*s.separation.T)[:, None]
            from_i = (
                to_j - away * (_INTO_SHELL * s.width * strong / strong.max(initial=1e-300))[:, None]
            )
            thick[strong > 0] = _ON_SHELL
        use = strong > mean if self._small else thick > 0.04
        segments = np.stack([from_i, to_j], axis=1)
        self._put(self._forces, s, segments[use], colour[use], moves, thick[use])

    def _segments(
        self, collection: "LineCollection", s: Snapshot, place: FloatArray, moves: FloatArray,
        use: NDArray[np.bool_], colour: FloatArray,
    ) -> None:  # fmt: skip
        ends = place[s.i[use]]
        segments = np.stack([ends, ends + s.separation[use]], axis=1)
        self._put(collection, s, segments, np.repeat(colour, len(ends), axis=0), moves)

    def _put(
        self, collection: "LineCollection", s: Snapshot, segments: FloatArray, colour: FloatArray,
        moves: FloatArray, thick: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Give a collection segments (C, 2, 2) with all of their images."""
        if len(segments) == 0:
            return
        middle = segments.mean(axis=1)
        who, move = self._seen(middle, moves, 2 * float(s.radius.max()))
        there = middle[who] + moves[move]
        own = (there >= 0).all(axis=1) & (there < [s.width, s.height]).all(axis=1)
        order = np.argsort(own, kind="stable")
        who, move, own = who[order], move[order], own[order]
        collection.set_segments(list(segments[who] + moves[move][:, None]))
        collection.set_color(dimmed(colour[who], ~own & s.periodic))  # type: ignore[arg-type]
        if thick is not None:
            collection.set_linewidth(list(thick[who]))

    def _edges(self, s: Snapshot, moves: FloatArray) -> None:
        """Draw the cell and its images, or walls."""
        if not s.periodic:
            self._own.set_segments([_wall(wall, s) for wall in s.walls])
            return
        corners = np.array([[0, 0], [s.width, 0], [s.width, s.height], [0, s.height], [0, 0]])
        self._own.set_segments([corners])
        self._cell.set_segments([corners + move for move in moves[1:]])


def view(snapshots: Sequence[Snapshot]) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of what a picture of these snapshots shows.

    The cell with a rim of its images; without images what is between the walls.
    """
    first = snapshots[0]
    wide, high = max(s.width for s in snapshots), max(s.height for s in snapshots)
    if first.periodic:
        rim = 2 * _MARGIN * float(first.radius.max())
        return -rim, -rim, wide + 2 * rim, high + 2 * rim
    floors = [w[2] for s in snapshots for w in s.walls if w[1] > 0.5] or [0.0]
    lids = [-w[2] for s in snapshots for w in s.walls if w[1] < -0.5] or [high]
    rim = 0.02 * wide
    bottom, top = float(min(floors)) - rim, float(max(lids)) + rim
    aside = rim if any(abs(wall[0]) > 0.5 for wall in first.walls) else 0.0
    return -aside, bottom, wide + 2 * aside, top - bottom


def dimmed(colours: FloatArray, which: NDArray[np.bool_]) -> FloatArray:
    """Return colours (n, 4) of which some are mixed with white."""
    made = colours.copy()
    made[which, :3] = 1 - (1 - _DIMMED) * (1 - made[which, :3])
    return made


def _limits(values: Sequence[FloatArray], colour: str) -> tuple[float, float]:
    """Return the ends of the colour scale of all snapshots."""
    if not values:
        return 0.0, 1.0
    everything = np.concatenate(values)
    low, high = (float(p) for p in np.percentile(everything, [100 - _FULL, _FULL]))
    if colour == "spin":
        low, high = -max(-low, high), max(-low, high)
    elif colour in {"speed", "displacement"}:
        low = 0.0
    return (low, high) if low < high else (low, low + 1.0)


def _wall(wall: FloatArray, s: Snapshot) -> Any:
    """Return the edge of a wall as a segment (2, 2) across the picture."""
    normal, position = wall[:2], float(wall[2])
    along = np.array([-normal[1], normal[0]])
    middle = position * normal + along * (along @ np.array([s.width, s.height])) / 2
    return np.array([middle - 0.5 * s.width * along, middle + 0.5 * s.width * along])
