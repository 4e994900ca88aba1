"""What the tables of a study hold: one row per what, and every column with unit and meaning.

=========================  ===================================  =============================
table                      one row per                          joins by
=========================  ===================================  =============================
``runs``                   finished job of the plan             ``job``, ``point``, ``curve``
``cycles``                 whole period of a run                ``job``, ``point``
``harmonics``              harmonic (1 to 9) of a run           ``job``, ``point``
``historical``             run, tensor, historical estimator    ``job``, ``point``
``curves``                 point of the plan                    ``point``, ``curve``
``features``               curve and landmark                   ``curve``
``contrasts``              comparison of curves                 parameters
``steady``                 point of the plan, in steady shear   ``point``
``compression``            point of the plan, in compression    ``point``
``self_propelled``         point of the plan, self-propelled    ``point``
``body_force``             point of the plan, under a force     ``point``
``stages``                 point of the plan, driven in stages  ``point``
``diametral_compression``  point of the plan, between plates    ``point``
``compaction``             point of the plan, under a lid       ``point``
``tension``                point of the plan, between grips     ``point``
``bending``                point of the plan, beams             ``point``
``pressure``               point of the plan, pressed rings     ``point``
``vibration``              point of the plan, vibrating rings   ``point``
``contact_laws``           compression of a pair, law
=========================  ===================================  =============================

A *point* is all replicates of one set of parameters, a *curve* all points that differ in the
strain amplitude alone. Varied parameters are columns of ``runs``, ``curves``, ``features`` and
``contrasts`` under their dotted keys of the study file; no other column has a dot. ``scene`` is
sorted as in the study file. What a model measures by itself (`MEASURED` of
`shear_sim.models.interface.Model`) is in ``runs`` and, where it is a number, in the tables from
``steady`` to ``vibration``.

In ``curves`` everything is of the *mean response*: the harmonics of the runs are averaged over
replicates first, and ratios such as tan δ and I3/I1 are formed after (see `response`). The mean of
the runs' own ratios would be biased: the harmonics of one small packing are mostly noise, whose
sign averages out and whose size does not.
"""

from shear_sim.models.interface import Column

#: Kinds of shear, each with its table of a row per point.
POINT_TABLES = {
    "oscillatory": "curves",
    "steady": "steady",
    "compression": "compression",
    "self_propelled": "self_propelled",
    "body_force": "body_force",
    "stages": "stages",
    "diametral_compression": "diametral_compression",
    "compaction": "compaction",
    "tension": "tension",
    "bending": "bending",
    "pressure": "pressure",
    "vibration": "vibration",
}

#: All tables that `shear_sim.aggregate` may write.
TABLES = {
    "runs", "cycles", "harmonics", "historical", "features", "contrasts", "contact_laws",
    *POINT_TABLES.values(),
}  # fmt: skip
#: Those that say in a last column ``tensor`` which stress tensor they are of; in ``runs`` it is
#: that of the harmonics and of all columns whose description names none.
OF_TENSOR = ("runs", "cycles", "harmonics", "curves", "features", "contrasts")

CONTACT_LAWS = (
    Column("law", "", "kind of contact law, with its parameters"),
    Column("of_study", "", "whether the study uses it; the others are there to compare"),
    Column("compression", "m", "compression D - d of two discs"),
    Column("force", "N/m", "repulsive force per metre of depth"),
)

LABELS = (
    Column("point", "", "id of the point, the same for all its replicates"),
    Column("curve", "", "id of the curve: what is varied, but for the strain amplitude"),
    Column("scene", "", "scene of the study"),
    Column("block", "", "block of the study's sweep"),
)

#: What a table with several tensors appends to the names of its moduli.
TENSORS = {"periodic": "", "internal": "_internal", "external": "_external"}
_MODULI = (
    Column("storage_modulus", "Pa", "G'"),
    Column("loss_modulus", "Pa", "G''"),
    Column("complex_modulus", "Pa", "|G*| = sqrt(G'^2 + G''^2)"),
    Column("tan_delta", "1", "G''/G'"),
)
MODULI = tuple(
    Column(f"{name}{suffix}", unit, f"{text} of the {tensor} tensor")
    for tensor, suffix in TENSORS.items()
    for name, unit, text in _MODULI
)
#: Of each run and of the mean response of each point; see `shear_sim.large_amplitude`.
LARGE_AMPLITUDE = (
    Column("third_harmonic_ratio", "1", "I3/I1, stress amplitudes of harmonics 3 and 1"),
    Column("even_harmonic_ratio", "1", "root sum of squares of I2, I4, I6, I8 / I1"),
    Column("minimum_strain_modulus", "Pa", "G'_M, tangent at zero strain"),
    Column("large_strain_modulus", "Pa", "G'_L, secant at the largest strain"),
    Column("minimum_rate_viscosity", "Pa s", "eta'_M, tangent at zero rate"),
    Column("large_rate_viscosity", "Pa s", "eta'_L, secant at the largest rate"),
    Column("stiffening_ratio", "1", "S = (G'_L - G'_M)/G'_L; > 0: stiffens with strain"),
    Column("thickening_ratio", "1", "T = (eta'_L - eta'_M)/eta'_L; > 0: thickens with rate"),
    Column("dissipated_energy", "J/m^3", "lost per cycle and volume: pi A^2 G''"),
    Column("plastic_ratio", "1", "dissipated energy / that of a perfect plastic of this peak"),
)
#: Each with its key in the index of the results.
OSCILLATORY = (
    (Column("in_phase_stress", "Pa", "G' A, Table S2-2"), "in_phase"),
    (Column("out_of_phase_stress", "Pa", "G'' A, Table S2-2"), "out_of_phase"),
    (Column("total_stress", "Pa", "|G*| A, Table S2-2"), "total"),
    (Column("peak_stress", "Pa", "half peak-to-peak of the stress without drift"), "peak"),
    (Column("mean_stress", "Pa", "constant part of the stress fit"), "offset"),
    (Column("drift", "Pa/s", "linear part of the stress fit"), "drift"),
    (Column("residual_stress", "Pa", "root mean square beside it"), "residual"),
)
#: Quality of a run, each with its key in the index of the results.
QUALITY = (
    (
        Column("baseline_noise", "1", "peak-to-peak stress at rest / stress amplitude"),
        "quality.baseline_noise",
    ),
    (
        Column("surface_internal_ratio", "1", "|G*| of the external / of the internal tensor"),
        "quality.surface_internal_ratio",
    ),
    (
        Column("cycle_change", "1", "relative change of |G*| between the last two periods"),
        "quality.cycle_change",
    ),
    (
        Column("drift_ratio", "1", "|drift| over one period / stress amplitude"),
        "quality.drift_ratio",
    ),
    (
        Column("jumps", "1", "steps from record to record over 15 % of the stress range"),
        "quality.jumps",
    ),
    (
        Column("largest_jump", "1", "largest step from record to record / stress range"),
        "quality.largest_jump",
    ),
    (
        Column("asymmetry", "1", "largest |s_xy - s_yx| / trace of the stress tensor"),
        "checks.asymmetry_periodic",
    ),
)
FLAGS = (
    Column("no_moduli", "", "why something could not be fitted"),
    Column("no_steady", "", "why nothing could be averaged"),
    Column("flags", "", "quality columns outside their limits, and flags of the model"),
    Column("flagged", "", "has flags, or no result; counted in all the same"),
)
#: Flags that a model sets itself.
MODEL_FLAGS = (
    "not_at_rest", "stopped_early", "deep_overlap", "forces_nonunique", "energy_missing", "inertia",
    "drag", "coarse", "sunk",
)  # fmt: skip
STEADY = (
    (Column("shear_stress", "Pa", "mean over the late half of the strain"), "steady.shear_stress"),
    (
        Column("shear_stress_error", "Pa", "its standard error, from block means"),
        "steady.shear_stress_error",
    ),
    (Column("viscosity", "Pa s", "mean shear stress / strain rate"), "steady.viscosity"),
    (
        Column("viscosity_error", "Pa s", "its standard error, from block means"),
        "steady.viscosity_error",
    ),
    (Column("pressure", "Pa", "mean over the late half of the strain"), "steady.pressure"),
    (Column("stress_ratio", "1", "|shear stress| / pressure"), "steady.stress_ratio"),
)
REPLICATE = Column("replicate", "1", "number of the replicate, from 0")
JOB = Column("job", "", "name of the run's file in jobs/")

CYCLES = (
    JOB,
    LABELS[0],
    REPLICATE,
    Column("cycle", "1", "number of the period, from 1"),
    Column("fitted", "", "part of the fit of the run's moduli (the first is not)"),
    Column("storage_modulus", "Pa", "G' of this period alone"),
    Column("loss_modulus", "Pa", "G'' of this period alone"),
)
HARMONICS = (
    JOB,
    LABELS[0],
    REPLICATE,
    Column("harmonic", "1", "n, of sin and cos n theta; strain = A sin theta"),
    Column("storage_modulus", "Pa", "G'_n: stress = A sum_n G'_n sin n theta + G''_n cos n theta"),
    Column("loss_modulus", "Pa", "G''_n"),
    Column("relative_intensity", "1", "I_n/I_1 with I_n = sqrt(G'_n^2 + G''_n^2)"),
)
HISTORICAL = (
    JOB,
    LABELS[0],
    REPLICATE,
    Column("tensor", "", "stress tensor: periodic, internal or external"),
    Column("estimator", "", "r-compat, header-compat, no-detrend or detrended"),
    Column("storage_modulus", "Pa", "G' by this estimator"),
    Column("loss_modulus", "Pa", "G'' by this estimator"),
    Column("drift", "Pa/s", "slope between the rests; added by header-compat"),
    Column("jumps", "1", "steps that r-compat takes out"),
    Column("largest_jump", "Pa", "the largest of them"),
    Column("rows", "1", "records of its window"),
    Column("no_moduli", "", "why there are none"),
)
COUNTS = (
    Column("replicates", "1", "finished runs"),
    Column("planned", "1", "runs of the plan"),
    Column("failed", "1", "runs that failed"),
    Column("flagged", "1", "finished runs outside a quality limit; they are counted in"),
    Column("n", "1", "runs with a result: what the intervals are over"),
)
#: Suffixes of a quantity in ``curves`` and ``steady``: (suffix, has the quantity's unit, meaning).
STATISTICS = (
    ("mean", True, "of the mean response: "),
    ("median", True, "median of the runs' own: "),
    ("sd", True, "standard deviation of the runs' own: "),
    ("ci_low", True, "lower bound of the interval of ..._mean"),
    ("ci_high", True, "upper bound of the interval of ..._mean"),
    ("ci_method", False, "BCa, percentile, t, t_log, equal or none"),
    ("ci_flag", False, "what weakens the interval; empty: nothing"),
)


def statistics_of(quantity: Column) -> list[Column]:
    """Return the columns of a quantity in ``curves`` and ``steady``."""
    return [
        Column(
            f"{quantity.name}_{suffix}",
            quantity.unit if has_unit else "",
            f"{text}{quantity.description}" if text.endswith(": ") else text,
        )
        for suffix, has_unit, text in STATISTICS
    ]


#: Quantities of ``curves``.
CURVE_QUANTITIES = (*_MODULI, OSCILLATORY[2][0], *LARGE_AMPLITUDE)
INTERVALS = (
    Column("ci_level", "1", "confidence level of the intervals"),
    Column("ci_resamples", "1", "resamples of their bootstrap"),
    Column("ci_seed", "1", "seed of their bootstrap"),
)

#: Landmarks of a curve, the values of column ``landmark`` of ``features``.
LANDMARKS = {
    "low_strain_plateau": "the smallest strain amplitude",
    "softening": "G' has fallen to 90 % of its low-strain plateau",
    "half_loss": "G' has fallen to 50 % of its low-strain plateau",
    "loss_peak": "first maximum of G'' from which it falls by 10 % or more",
    "soft_plateau": "ln G' falls least steeply after it has fallen more steeply",
    "first_crossover": "G'' overtakes G' for the first time",
    "yield": "G'' overtakes G' for the last time; its total_stress is the yield stress",
    "nonlinearity_onset": "I3/I1 of the mean response first exceeds 1 %",
}
#: Quantities of ``features``, each with the suffixes ci_low, ci_high, ci_method and ci_flag.
FEATURE_QUANTITIES = (
    Column("strain", "1", "strain amplitude of the landmark"),
    Column("storage_modulus", "Pa", "G' there"),
    Column("loss_modulus", "Pa", "G'' there"),
    Column("total_stress", "Pa", "|G*| A there"),
)
FEATURES = (
    Column("curve", "", "id of the curve"),
    LABELS[2],
    # varied parameters but for the strain amplitude
    Column("replicates", "1", "finished runs of the amplitude that has the fewest"),
    Column("planned", "1", "runs of the plan at each amplitude"),
    Column("amplitudes", "1", "strain amplitudes with runs: points of the curve"),
    Column("landmark", "", "which landmark"),
    # FEATURE_QUANTITIES
    Column("strain_before", "1", "largest amplitude measured up to it"),
    Column("strain_after", "1", "smallest amplitude measured beyond it"),
    Column("censored", "", "empty; above or below: beyond the amplitudes; absent: none"),
    Column("strain_limit", "1", "largest (above) or smallest (below) amplitude, where censored"),
    Column("censored_resamples", "1", "fraction of the resampled curves that are censored"),
    *INTERVALS,
)
CONTRASTS = (
    Column("parameter", "", "what differs: a varied parameter, or scene"),
    Column("scene", "", "scene, or the scene that is compared"),
    # varied parameters: those held equal; empty for the one that differs
    Column("against", "", "scene or value that it is compared with; empty for slopes"),
    Column("values", "", "values of the parameter that take part"),
    Column("effect", "", "ratio, exponent (d ln y/d ln x) or slope (d ln y/d x)"),
    Column("landmark", "", "y is of this landmark; empty: at the strain amplitude of this row"),
    Column("quantity", "", "y: strain, storage_modulus, loss_modulus or total_stress"),
    Column("replicates", "1", "runs of the point that has the fewest"),
    Column("planned", "1", "runs of the plan at each point"),
    Column("estimate", "1", "the effect"),
    Column("ci_low", "1", "lower bound of its interval"),
    Column("ci_high", "1", "upper bound of its interval"),
    Column("ci_method", "", "BCa, percentile, t, t_log, equal or none"),
    Column("ci_flag", "", "what weakens the interval; empty: nothing"),
    Column("p", "1", "p-value of no effect (ratio 1, exponent or slope 0)"),
    Column("p_holm", "1", "the same, corrected by Holm within the family"),
    Column("family", "", "the rows corrected together: parameter, landmarks or amplitudes"),
    *INTERVALS,
)
