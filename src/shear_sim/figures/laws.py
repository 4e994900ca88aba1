"""Contact laws: force against compression, as Fig. S1-3 of the particleShear manual."""

from typing import TYPE_CHECKING

from shear_sim.figures import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_LINES = ("-", "--", "-.", ":")


def contact_laws(table: "pd.DataFrame", *notes: str) -> "Figure":
    """Draw the repulsive force of contact laws against how far two discs are pressed together.

    Parameters
    ----------
    table : DataFrame
        ``law`` (a line each, in the order of the table), ``of_study`` (drawn thick),
        ``compression`` [m] and ``force``, per metre of depth [N/m].
    *notes : str
        Lines above the figure: of which discs the forces are, how much of the study is there.
    """
    with style.figure(style.SINGLE, 3.4) as figure:
        axis = figure.subplots()
        laws = table.groupby("law", sort=False)
        for turn, (law, line) in enumerate(laws):
            axis.plot(
                line["compression"] * 1e6, line["force"] * 1e3, linestyle=_LINES[turn % 4],
                color=style.UNORDERED[turn % len(style.UNORDERED)], label=law,
                linewidth=2.2 if line["of_study"].all() else 0.9,
            )  # fmt: skip
        axis.set_xlabel(r"compression $\Delta x$ [µm]")
        axis.set_ylabel("force per depth $F/L$ [mN/m]")
        axis.set_xlim(0, float(table["compression"].max()) * 1e6)
        # A law that diverges at full compression leaves the panel on its way there.
        within = table["compression"] <= 0.8 * table["compression"].max()
        axis.set_ylim(0, 1.2e3 * float(table.loc[within, "force"].max()))
        figure.legend(loc="outside lower center", ncols=2, columnspacing=1.2)
        style.note(figure, *notes)
    return figure
