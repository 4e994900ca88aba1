"""Pictures of particles: the Lees–Edwards cell with its images, contacts and forces.

Links, and contacts that hold or slide, have the colours of the manual's figure S1-1a: a link is
blue with an orange interface, an interface that holds is red, one that slides is green. Shells,
whose vertices are the particles of a snapshot, are drawn as what they enclose, in a blue membrane.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures.colouring import Colouring
from shear_sim.figures.geometry import in_rectangle, interfaces, outlines, particle_tints
from shear_sim.figures.shells import Shells, is_shells
from shear_sim.looks import Colour, Contacts
from shear_sim.models.interface import BAR, COHESIVE, CONTACT, LINK, SLIDING, Snapshot
from shear_sim.snapshots import clusters

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.legend import Legend

FloatArray = NDArray[np.float64]

_EDGE = "#5a6470"
_LINK, _INTERFACE, _HOLDS, _SLIDES = "#0a5fa8", "#f08c00", "#c8102e", "#00a35c"
_PUSH, _PUSH_ON_SCALE, _PULL = "#8c1016", "#20242a", "#0a5fa8"
_KINDS = (_INTERFACE, _HOLDS, _SLIDES, _INTERFACE)  # of interfaces
_DIMMED = 0.62  # of white in what lies outside of the cell
_CORNERS = 36  # of a disc; half as many where it is small
_SMALL = 7.0  # points: of smaller discs contacts are drawn as forces
_EDGELESS = 4.0  # points: smaller discs have no edges
_LARGE = 16.0  # points: lines of forces grow no wider with larger discs
_INTO_SHELL = 0.12  # of the picture: the longest line of a force on a single shell
_ON_SHELL = 0.9  # points: its width
_LOADED = 0.02  # of the largest mean force, from which a snapshot has a part in what is usual
_TWICE = 2.0  # as wide as is usual: the mean force of a snapshot is drawn no wider
_ROOM = 10.0  # points²: all forces would be too many where each has less of the picture
_PALE, _PALER = 0.8, 0.5  # of the colours below forces; below forces that are too many
_OVER_COLOURS = 0.6  # width of forces where they lie on colours that are to be read
_WEIGHT = 11.0  # points: half of the arrow that shows which way things fall
_THINNEST = 0.04  # points, of a line of a force
_MARGIN = 0.7  # around the cell, in largest diameters
_RIM = 0.06  # of the cell, where that is more


class Scene:
    """One panel with particles, which shows one snapshot after another.

    Parameters
    ----------
    axis : Axes
        Where to draw; its place in the figure should be settled, as lines are as thick as
        particles are large.
    snapshots : sequence of Snapshot
        Of one job: colours mean the same in all of them, and widths up to twice the usual load.
    gradient : (len(snapshots), 2, 2)
        Imposed deformation gradient at each.
    colour : Colour or str
        ``particle``: its cluster of links; large or small where there are none.
        ``displacement``: from the affine image of where it was in the first snapshot.
    contacts : Contacts or str, optional
        Default: what can be seen.
    only : int, optional
        Number of the one snapshot that is shown: colours and widths are then scaled by it alone.

    Raises
    ------
    ValueError
        If one of both is no such word.
    """

    def __init__(
        self,
        axis: "Axes",
        snapshots: Sequence[Snapshot],
        gradient: FloatArray,
        colour: str = "particle",
        contacts: str | None = None,
        only: int | None = None,
    ) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self.axis, self.snapshots = axis, snapshots
        self._shells = Shells(snapshots[0]) if is_shells(snapshots[0]) else None
        numbers = range(len(snapshots)) if only is None else [only]
        #: By its number, one disc for each particle of the picture; bars are no contacts.
        self._particles = {n: self._as_discs(snapshots[n]) for n in numbers}
        self._left, self._bottom, self.width, self.height = view([snapshots[n] for n in numbers])
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
        first = self._as_discs(snapshots[0])
        self.diameter = 2 * self.point * float(first.radius.mean())  # [points]
        self._small = self.diameter < _SMALL
        body = np.arange(len(self._shells)) if self._shells else clusters(snapshots[0])
        tints = particle_tints(first, body)
        since = gradient @ np.linalg.inv(gradient[0])
        self.colours = Colouring(self._particles, first, since, Colour(colour), tints)
        self.contacts = Contacts(contacts or self._readable())
        self._usual, self._largest = self._forces_of_all()
        most = max(int((_strength(s) > 0).sum()) for s in self._particles.values())
        self._crowded = most * _ROOM > self.width * self.height * self.point**2
        if self._shells:
            edge, self._edge = 2 * self.point * float(snapshots[0].radius.mean()), _LINK
        elif self.diameter < _EDGELESS:
            edge, self._edge = 0.0, "none"
        else:
            edge, self._edge = min(0.035 * self.diameter, 0.6), _EDGE
        self._bodies = PolyCollection([], linewidths=edge, joinstyle="round")
        self._bars = LineCollection([], linewidths=max(self.diameter, 1.0))
        self._links = LineCollection([], linewidths=self._line(0.04))
        self._interfaces = LineCollection([])
        self._forces = LineCollection([])
        self._cell = LineCollection([], colors="0.15", linewidths=0.8, linestyles="dashed")
        self._own = LineCollection([], colors="0.1", linewidths=1.1)
        self.artists: tuple[Artist, ...] = (
            self._bodies, self._links, self._interfaces, self._forces, self._cell, self._own,
            self._bars,
        )  # fmt: skip
        for order, artist in enumerate(self.artists):
            artist.set(zorder=2 + order)
            axis.add_collection(artist, autolim=False)
        self._bars.set(zorder=self._bodies.zorder)
        for artist in (self._bars, self._links, self._interfaces, self._forces):
            artist.set_capstyle("round")

    def draw_weight(self, inclination: float) -> None:
        """Draw in a corner which way things fall, at this angle [degree] from −y to x."""
        from matplotlib.patches import Circle, FancyArrowPatch

        angle = math.radians(inclination)
        down = np.array([math.sin(angle), -math.cos(angle)])
        half = _WEIGHT / self.point
        first = self.snapshots[0]
        corner = (self._left + self.width, first.width), (self._bottom + self.height, first.height)
        middle = np.array([min(seen) for seen in corner]) - 1.8 * half
        ground = Circle((float(middle[0]), float(middle[1])), 1.2 * half, color="white", alpha=0.85)
        arrow = FancyArrowPatch(
            *(middle - half * down, middle + half * down),  # type: ignore[arg-type]
            arrowstyle="-|>", mutation_scale=10, shrinkA=0, shrinkB=0, color=_PUSH_ON_SCALE,
        )  # fmt: skip
        for artist in (ground, arrow):
            self.axis.add_patch(artist)
        beside = middle + 0.55 * half * np.array([-down[1], down[0]]) - 0.5 * half * down
        x, y = (float(place) for place in beside)
        letter = self.axis.text(x, y, "$g$", ha="center", va="center", fontsize=8)
        shown: tuple[Artist, ...] = (ground, arrow, letter)
        for each in shown:
            each.set(zorder=20, clip_on=True)
        self.artists += shown

    def _as_discs(self, s: Snapshot) -> Snapshot:
        return self._shells.as_discs(s) if self._shells else without_bars(s)

    def _line(self, of_diameter: float) -> float:
        return min(max(of_diameter * self.diameter, 0.25), 2.5)

    @property
    def _alone(self) -> bool:
        """Whether there is one shell: forces on it are then drawn where they act."""
        return self._shells is not None and len(self._shells) == 1

    def _readable(self) -> str:
        first = self.snapshots[0]
        if (first.kind == COHESIVE).any():
            return "none"  # a crack is seen by its gap
        if self._shells or not first.periodic:
            return "force"
        if sum([self._small, self.colours.scaled, LINK in first.kind]) > 1:
            return "none"  # particles are seen by their colours
        held = any((s.kind != CONTACT).any() for s in self.snapshots)
        return "state" if held and not self._small else "force"

    def _forces_of_all(self) -> tuple[float, float]:
        """Return the usual mean force of those that are loaded, and the largest of all forces."""
        if self._alone:
            forces = [self.snapshots[n].normal[self.snapshots[n].j < 0] for n in self._particles]
        else:
            forces = [_strength(s) for s in self._particles.values()]
        means = np.array([_mean(f) for f in forces])
        usual = float(np.median(means[means >= _LOADED * means.max()]))
        return usual, max(float(f.max(initial=0.0)) for f in forces)

    def legend(self, axis: "Axes", columns: int = 1) -> "Legend | None":
        """Say in ``axis`` what the lines are."""
        from matplotlib.lines import Line2D

        def line(colour: str, text: str, width: float = 2.2) -> Line2D:
            return Line2D([], [], color=colour, linewidth=width, label=text)

        kinds = set(np.concatenate([np.unique(s.kind) for s in self.snapshots]).tolist())
        shown = []
        if self.contacts == "state":
            shown += [line(_LINK, "link")] * (LINK in kinds)
            theirs = "its interface" if LINK in kinds else "interface of a link"
            shown += [line(_INTERFACE, theirs)] * bool(kinds & {LINK, COHESIVE})
            held = "contact holds" if SLIDING in kinds else "contact"
            shown += [line(_HOLDS, held)] * (CONTACT in kinds)
            shown += [line(_SLIDES, "slides")] * (SLIDING in kinds)
        elif self.contacts == "force":
            push = _PUSH_ON_SCALE if self.colours.scaled else _PUSH
            way = "length as force" if self._alone else "width as force"
            if self._crowded and not self._alone:
                way += "\nabove the mean"
            pushes, pulls = self._ways()
            shown += [line(push, f"push; {way}")] * pushes
            shown += [line(_PULL, "pull" if pushes else f"pull; {way}")] * pulls
        if not shown:
            return None
        return axis.legend(
            handles=shown, loc="lower left", ncols=columns, handlelength=1.1, handletextpad=0.6,
            columnspacing=0.8, borderpad=0, borderaxespad=0,
        )  # fmt: skip

    def _ways(self) -> tuple[bool, bool]:
        """Return whether there are lines of forces that push, and of those that pull."""
        if self._alone:
            return bool(self._largest > 0), False
        drawn = [s.normal[self._thickness(s) > 0] for s in self._particles.values()]
        return any((f >= 0).any() for f in drawn), any((f < 0).any() for f in drawn)

    # --- Drawing ---------------------------------------------------------------------------------

    def show(self, number: int) -> None:
        """Show snapshot ``number``."""
        s = self._particles[number]
        place, moves = in_rectangle(s), self._moves(s)
        self._draw_bodies(number, place, moves)
        for collection in (self._bars, self._links, self._interfaces, self._forces):
            collection.set_segments([])
        if not self._shells:
            self._draw_bars(number, place, moves)
        if self.contacts == "state":
            self._draw_state(number, place, moves)
        elif self.contacts == "force" and self._alone:
            self._draw_pushes(number, place)
        elif self.contacts == "force":
            self._draw_forces(s, place, moves)
        self._draw_edges(s, moves)

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
        self, s: Snapshot, place: FloatArray, moves: FloatArray, reach: float, across: FloatArray
    ) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.bool_]]:
        """Return which images of points (N, 2) are within the picture, or ``reach`` of it.

        The number of the point of each, by how much it is displaced (·, 2), and whether it lies
        outside of the cell; those in it come last, and so on top. What goes ``across`` its point
        (N, 2), as far to the one side as to the other, lies outside where both ends do.
        """
        there = place[:, None] + moves
        low = np.array([self._left, self._bottom])
        high = low + np.array([self.width, self.height])
        seen = ((there > low - reach) & (there < high + reach)).all(axis=2)
        who, move = np.nonzero(seen)
        inside = np.full(len(who), not s.periodic)
        for end in (-across, across):
            at = there[who, move] + end[who]
            inside |= ((at >= 0) & (at < [s.width, s.height])).all(axis=1)
        order = np.argsort(inside, kind="stable")
        return who[order], moves[move[order]], ~inside[order]

    def _draw_bodies(self, number: int, place: FloatArray, moves: FloatArray) -> None:
        from matplotlib.colors import to_rgba_array

        s = self._particles[number]
        shapes: list[FloatArray] | FloatArray
        if self._shells:
            shapes = self._shells.outlines(self.snapshots[number])
            reach = max(float(np.abs(shape).max()) for shape in shapes)
        else:
            shapes = outlines(s, _CORNERS // 2 if self._small else _CORNERS)
            reach = float(s.radius.max())
        # Held particles that an edge cuts are the plate on both of its sides.
        across = np.where(s.fixed, 0.5 * s.radius, 0.0)[:, None] * [0.0, 1.0]
        who, move, outside = self._seen(s, place, moves, reach, across)
        at = place[who] + move
        self._bodies.set_verts([shapes[k] + centre for k, centre in zip(who, at, strict=True)])
        faces = self.colours.faces(number)
        if self.contacts == "force" and not self.colours.scaled:
            pale = _PALER if self._crowded and not self._alone else _PALE
            faces[:, :3] = 1 - pale * (1 - faces[:, :3])
        self._bodies.set_facecolor(dimmed(faces[who], outside))  # type: ignore[arg-type]
        edges = to_rgba_array([self._edge] * len(who))
        self._bodies.set_edgecolor(dimmed(edges, outside))  # type: ignore[arg-type]

    def _draw_bars(self, number: int, place: FloatArray, moves: FloatArray) -> None:
        """Draw the bars of open chains as lines of their thickness."""
        s = self.snapshots[number]
        bars = s.kind == BAR
        i, j = s.i[bars], s.j[bars]
        segments = np.stack([place[i], place[i] + s.separation[bars]], axis=1)
        shown = np.where(s.fixed[i], j, i)  # a bar is held where both of its ends are
        self._put(self._bars, s, segments, self.colours.faces(number)[shown], moves)

    def _draw_state(self, number: int, place: FloatArray, moves: FloatArray) -> None:
        """Draw links and interfaces, which show whether a contact holds or slides."""
        from matplotlib.colors import to_rgba_array

        s = self._particles[number]
        if self._shells:
            who, faces, kind = self._shells.interfaces(self.snapshots[number])
        else:
            links = s.kind == LINK
            ends = place[s.i[links]]
            segments = np.stack([ends, ends + s.separation[links]], axis=1)
            self._put(self._links, s, segments, to_rgba_array([_LINK] * len(ends)), moves)
            faces = interfaces(s)
            there = np.ptp(faces, axis=1).any(axis=1)
            who, kind, faces = s.i[there], s.kind[there], faces[there]
        colours = to_rgba_array(_KINDS)[kind]
        # What holds or slides is to be seen between all that is linked.
        wide = np.where(np.isin(kind, [CONTACT, SLIDING]), self._line(0.06), self._line(0.04))
        self._put(self._interfaces, s, place[who, None] + faces, colours, moves, wide)

    def _thickness(self, s: Snapshot) -> FloatArray:
        """Return how thick the lines of forces (C,) are [points]; 0: what is not drawn."""
        strong = _strength(s)
        mean = max(self._usual, _mean(strong) / _TWICE)
        share = strong / mean if mean > 0 else strong
        if self._crowded:  # all of them would be a net without chains
            wide = np.clip(0.2 * (share - 1), 0.0, 0.4)
        else:
            wide = np.minimum(0.08 * share, 0.3)
        thick = wide * min(max(self.diameter, 3.0), _LARGE)
        if self.colours.scaled:
            thick = _OVER_COLOURS * thick
        return np.where(thick > _THINNEST, thick, 0.0)

    def _draw_forces(self, s: Snapshot, place: FloatArray, moves: FloatArray) -> None:
        """Draw lines from centre to centre, as wide as forces are strong."""
        from matplotlib.colors import to_rgba_array

        push = _PUSH_ON_SCALE if self.colours.scaled else _PUSH
        colour = to_rgba_array([push, _PULL])[(s.normal < 0).astype(int)]
        from_i = place[s.i]
        segments = np.stack([from_i, from_i + s.separation], axis=1)
        thick = self._thickness(s)
        use = thick > 0
        self._put(self._forces, s, segments[use], colour[use], moves, thick[use])

    def _draw_pushes(self, number: int, place: FloatArray) -> None:
        """Draw what walls do to a single shell: lines into it, as long as forces are strong."""
        from matplotlib.colors import to_rgba_array

        assert self._shells is not None  # noqa: S101 - it is alone
        touches = self._shells.touches(self.snapshots[number])
        to = place[touches.shell] + touches.at + touches.separation
        away = touches.separation / np.hypot(*touches.separation.T)[:, None]
        length = _INTO_SHELL * self.width * touches.normal / max(self._largest, 1e-300)
        push = to_rgba_array(_PUSH_ON_SCALE if self.colours.scaled else _PUSH)
        self._forces.set_segments(list(np.stack([to - length[:, None] * away, to], axis=1)))
        self._forces.set(colors=push, linewidths=_ON_SHELL)

    def _put(
        self, collection: "LineCollection", s: Snapshot, segments: FloatArray, colour: FloatArray,
        moves: FloatArray, thick: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Give a collection segments (C, 2, 2) with all of their images."""
        if len(segments) == 0:
            return
        reach = 2 * float(s.radius.max())
        middle, across = segments.mean(axis=1), 0.5 * (segments[:, 1] - segments[:, 0])
        who, move, outside = self._seen(s, middle, moves, reach, across)
        collection.set_segments(list(segments[who] + move[:, None]))
        collection.set_color(dimmed(colour[who], outside))  # type: ignore[arg-type]
        if thick is not None:
            collection.set_linewidth(list(thick[who]))

    def _draw_edges(self, s: Snapshot, moves: FloatArray) -> None:
        """Draw the cell and its images, or walls."""
        if not s.periodic:
            self._own.set_segments([_wall(wall, s) for wall in s.walls])
            return
        corners = np.array([[0, 0], [s.width, 0], [s.width, s.height], [0, s.height], [0, 0]])
        self._own.set_segments([corners])
        # Each edge once: dashes on dashes would look like a full line.
        left, right = self._left, self._left + self.width
        across = [np.array([[left, y], [right, y]]) for y in (0.0, s.height)]
        down = [np.stack([move, move + np.array([0, s.height])]) for move in moves]
        self._cell.set_segments([*across, *down])


def _strength(s: Snapshot) -> FloatArray:
    """Return how strong the forces (C,) are."""
    strong: FloatArray = np.hypot(s.normal, s.tangential)
    return strong


def _mean(strong: FloatArray) -> float:
    """Return the mean of those that are not zero."""
    return float(strong[strong > 0].mean()) if (strong > 0).any() else 0.0


def view(snapshots: Sequence[Snapshot]) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of what a picture of these snapshots shows.

    The cell with a rim of its images; without images all particles, and what is between walls.
    """
    first = snapshots[0]
    wide, high = max(s.width for s in snapshots), max(s.height for s in snapshots)
    if first.periodic:
        particles = Shells(first).as_discs(first) if is_shells(first) else first
        rim = max(2 * _MARGIN * float(particles.radius.max()), _RIM * min(wide, high))
        return -rim, -rim, wide + 2 * rim, high + 2 * rim
    rim = 0.02 * wide
    # Without walls at its sides a tissue goes beyond them, and discs of an open cell anywhere.
    low = np.min([(s.position - s.radius[:, None]).min(axis=0) for s in snapshots], axis=0)
    far = np.max([(s.position + s.radius[:, None]).max(axis=0) for s in snapshots], axis=0)
    floors = [w[2] for s in snapshots for w in s.walls if w[1] > 0.5] or [0.0, low[1]]
    lids = [-w[2] for s in snapshots for w in s.walls if w[1] < -0.5] or [high, far[1]]
    bottom, top = float(min(floors)) - rim, float(max(lids)) + rim
    left, right = min(0.0, float(low[0])), max(wide, float(far[0]))
    return left - rim, bottom, right - left + 2 * rim, top - bottom


def without_bars(s: Snapshot) -> Snapshot:
    """Return a snapshot without the bars of its chains."""
    keep = s.kind != BAR
    return s._replace(
        i=s.i[keep], j=s.j[keep], separation=s.separation[keep], normal=s.normal[keep],
        tangential=s.tangential[keep], kind=s.kind[keep],
    )  # fmt: skip


def dimmed(colours: FloatArray, which: NDArray[np.bool_]) -> FloatArray:
    """Return colours (n, 4) of which some are mixed with white."""
    made = colours.copy()
    made[which, :3] = 1 - (1 - _DIMMED) * (1 - made[which, :3])
    return made


def _wall(wall: FloatArray, s: Snapshot) -> Any:
    """Return the edge of a wall as a segment (2, 2) across the picture."""
    normal, position = wall[:2], float(wall[2])
    along = np.array([-normal[1], normal[0]])
    cell = np.array([s.width, s.height])
    middle = position * normal + along * (along @ cell) / 2
    half = 0.5 * (np.abs(along) @ cell) * along
    return np.array([middle - half, middle + half])
