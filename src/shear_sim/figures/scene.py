"""Pictures of particles: the Lees–Edwards cell with its images, contacts and forces.

Links, and contacts that hold or slide, have the colours of the manual's figure S1-1a: a link is
blue with an orange interface, an interface that holds is red, one that slides is green.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.looks import Colour, Contacts
from shear_sim.models.interface import CONTACT, LINK, SLIDING, Snapshot
from shear_sim.snapshots import clusters

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import Colormap
    from matplotlib.legend import Legend

FloatArray = NDArray[np.float64]

# Tints that letters and lines are seen on; neighbours get different ones.
_TINTS = ("#a6cee3", "#fdd7a5", "#b8dfb1", "#d9c3e4", "#f6bcbc", "#e9e29c", "#b5ddd8", "#dcc4ad")
_LARGE, _SMALL, _FIXED, _EDGE = "#a9c9e2", "#f6d3a8", "#9a9a9a", "#5a6470"
_LINK, _INTERFACE, _HOLDS, _SLIDES = "#0a5fa8", "#f08c00", "#c8102e", "#00a35c"
_PUSH, _PUSH_ON_SCALE, _PULL = "#8c1016", "#20242a", "#0a5fa8"
_DIMMED = 0.62  # of white in what lies outside of the cell
_CORNERS = 36  # of a disc; half as many where it is small
_SMALL_DISC = 7.0  # points: smaller ones have no edges, and contacts are drawn as forces
_INTO_SHELL = 0.12  # of the picture: the longest line of a force on a shell
_ON_SHELL = 0.9  # points: its width
_MARGIN = 0.7  # around the cell, in largest diameters
_ALIKE = 1.2  # ratio of radii under which discs count as equal
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
        self._shell = _is_shell(first)
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
        held = self._shell or any((s.kind != CONTACT).any() for s in self.snapshots)
        return "state" if held and first.periodic and self.diameter >= _SMALL_DISC else "force"

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
            way = "length: force / largest" if self._shell else "width: force / mean"
            shown += [line(push, f"push; {way}")]
            shown += [line(_PULL, "pull")] * any((s.normal < 0).any() for s in self.snapshots)
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
            trips = _round_trips(s)
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
        strong = np.abs(s.normal)
        if self._shell:
            strong = np.where(s.kind == LINK, 0.0, strong)
        mean = float(strong[strong > 0].mean()) if (strong > 0).any() else 1.0
        thick = np.minimum(0.1 * strong / mean, 0.4) * max(self.diameter, 3.0)
        push = _PUSH_ON_SCALE if self._values else _PUSH
        colour = to_rgba_array([push, _PULL])[(s.normal < 0).astype(int)]
        from_i = place[s.i]
        to_j = from_i + s.separation
        if self._shell:  # thin: what presses on it reaches into it
            away = s.separation / np.hypot(*s.separation.T)[:, None]
            from_i = (
                to_j - away * (_INTO_SHELL * s.width * strong / strong.max(initial=1e-300))[:, None]
            )
            thick[strong > 0] = _ON_SHELL
        use = thick > 0.04
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
    return 0.0, bottom, wide, top - bottom


def dimmed(colours: FloatArray, which: NDArray[np.bool_]) -> FloatArray:
    """Return colours (n, 4) of which some are mixed with white."""
    made = colours.copy()
    made[which, :3] = 1 - (1 - _DIMMED) * (1 - made[which, :3])
    return made


def in_rectangle(s: Snapshot) -> FloatArray:
    """Return the positions (N, 2) within the rectangle, whose upper images are displaced."""
    if not s.periodic:
        return s.position
    x, y = s.position.T
    up = np.floor(y / s.height)
    x, y = x - up * s.offset, y - up * s.height
    return np.column_stack([x - np.floor(x / s.width) * s.width, y])


def interfaces(s: Snapshot) -> FloatArray:
    """Return the ends (C, 2, 2) of all interfaces, from particle i.

    An interface is the chord that two circles share, as far as no third disc has a part in it (a
    face of the power diagram); discs that only touch have a short one, to be seen. Where there is
    none both ends are the same.
    """
    distance = np.hypot(*s.separation.T)
    normal = s.separation / distance[:, None]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    both = s.j >= 0
    ri = s.radius[s.i]
    rj = np.where(both, s.radius[s.j], 0.0)
    along = np.where(both, (distance**2 + ri**2 - rj**2) / (2 * distance), distance)
    least = 0.2 * np.minimum(ri, np.where(both, rj, ri))
    half = np.maximum(np.sqrt(np.maximum(ri**2 - along**2, 0.0)), least)
    half[both & (distance > (ri + rj) * (1 + 1e-9))] = 0.0
    low, high = -half, half.copy()
    # Both discs of a contact see their other contacts as half-planes that cut the chord.
    ends = np.concatenate([s.i, s.j])
    contact = np.tile(np.arange(len(s.i)), 2)
    face = np.concatenate([normal, -normal])
    reach = np.concatenate([along, distance - along])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], ends)
    count = np.searchsorted(ends[order], ends, side="right") - first
    one = np.repeat(np.arange(len(ends)), count)
    other = order[
        np.repeat(first, count) + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    ]
    use = (contact[one] != contact[other]) & (ends[one] >= 0)
    one, other = one[use], other[use]
    slope = (tangent[contact[one]] * face[other]).sum(axis=1)
    room = reach[other] - reach[one] * (face[one] * face[other]).sum(axis=1)
    limit = room / np.where(np.abs(slope) > 1e-12, slope, 1e-12)
    up = slope > 0
    np.minimum.at(high, contact[one[up]], limit[up])
    np.maximum.at(low, contact[one[~up]], limit[~up])
    low, high = np.minimum(low, high), np.where(low < high, high, np.minimum(low, high))
    middle = normal * along[:, None]
    return np.stack([middle + low[:, None] * tangent, middle + high[:, None] * tangent], axis=1)


def outlines(s: Snapshot, corners: int) -> FloatArray:
    """Return the outlines (N, corners, 2) of discs around their centres, flat at interfaces.

    Two discs that overlap share the chord of their circles.
    """
    angle = 2 * np.pi * np.arange(corners) / corners
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    reach = np.repeat(s.radius[:, None], corners, axis=1)
    distance = np.hypot(*s.separation.T)
    both = s.j >= 0
    deep = both & (distance < 0.9999 * (s.radius[s.i] + np.where(both, s.radius[s.j], 0)))
    i, j, r, d = s.i[deep], s.j[deep], s.separation[deep], distance[deep]
    for one, other, sign in ((i, j, 1.0), (j, i, -1.0)):
        chord = (d**2 + s.radius[one] ** 2 - s.radius[other] ** 2) / (2 * d)
        toward = sign * (r / d[:, None]) @ ray.T
        limit = np.where(toward > 1e-9, chord[:, None] / np.maximum(toward, 1e-9), np.inf)
        np.minimum.at(reach, one, np.maximum(limit, 0.0))
    shaped: FloatArray = reach[:, :, None] * ray
    return shaped


def particle_pressure(s: Snapshot) -> FloatArray:
    """Return the pressure (N,) of each particle: half the trace of its own virial over its area.

    The virial of a contact is shared as its length is, in parts r_i and r_j, so that the areas
    times the pressures sum to the pressure of all contacts times the area of the cell.
    """
    both = s.j >= 0
    ri, rj = s.radius[s.i], np.where(both, s.radius[s.j], 0.0)
    virial = 0.5 * s.normal * np.hypot(*s.separation.T)
    total = np.bincount(s.i, virial * ri / (ri + rj), len(s.radius))
    total += np.bincount(s.j[both], (virial * rj / (ri + rj))[both], len(s.radius))
    pressure: FloatArray = total / (np.pi * s.radius**2)
    return pressure


def displacement(now: Snapshot, first: Snapshot, strain: float) -> FloatArray:
    """Return how far each particle (N, 2) is from the affine image of its place in ``first``.

    To the nearest image; ``strain`` is what was imposed in between.
    """
    scale = now.height / first.height
    x, y = (first.position * scale).T
    away: FloatArray = now.position - np.column_stack([x + strain * y, y])
    if now.periodic:
        up = np.rint(away[:, 1] / now.height)
        away -= np.column_stack([up * now.offset, up * now.height])
        away[:, 0] -= np.rint(away[:, 0] / now.width) * now.width
    return away


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


def particle_tints(s: Snapshot) -> NDArray[np.str_]:
    """Return tints (N,) of particles: no two clusters that touch have the same, where possible."""
    body = clusters(s)
    alone = body < 0
    middle = 0.5 * float(s.radius.min() + s.radius.max())
    large = (s.radius > middle) | (s.radius.max() < _ALIKE * s.radius.min())
    tints = np.where(large, _LARGE, _SMALL)
    numbers, body = np.unique(body, return_inverse=True)
    touching: list[set[int]] = [set() for _ in numbers]
    both = s.j >= 0
    for a, b in zip(body[s.i[both]].tolist(), body[s.j[both]].tolist(), strict=True):
        if a != b:
            touching[a].add(b)
            touching[b].add(a)
    chosen = [-1] * len(numbers)
    used = dict.fromkeys(range(len(_TINTS)), 0)  # how often
    for number in range(len(numbers)):
        taken = {chosen[other] for other in touching[number]}
        free = [k for k in used if k not in taken] or list(used)
        chosen[number] = min(free, key=used.__getitem__)
        used[chosen[number]] += 1
    return np.where(alone, tints, np.array(_TINTS)[chosen][body])


def _is_shell(s: Snapshot) -> bool:
    """Whether particles are the vertices of closed shells."""
    links = s.kind == LINK
    degree = np.bincount(np.concatenate([s.i[links], s.j[links]]), minlength=len(s.radius))
    return not s.periodic and bool((degree == 2).all())


def _round_trips(s: Snapshot) -> list[list[int]]:
    """Return the vertices of each shell in order."""
    links = s.kind == LINK
    after = dict(zip(s.i[links].tolist(), s.j[links].tolist(), strict=True))
    trips = []
    while after:
        trip = [next(iter(after))]
        while (vertex := after.pop(trip[-1])) != trip[0]:
            trip.append(vertex)
        trips.append(trip)
    return trips


def _wall(wall: FloatArray, s: Snapshot) -> Any:
    """Return the edge of a wall as a segment (2, 2) across the picture."""
    normal, position = wall[:2], float(wall[2])
    along = np.array([-normal[1], normal[0]])
    middle = position * normal + along * (along @ np.array([s.width, s.height])) / 2
    return np.array([middle - 0.5 * s.width * along, middle + 0.5 * s.width * along])
