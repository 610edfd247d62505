"""Effects that equations (1) and (2) lack and that have a name, slot by slot.

They belong to the contact, to the tool or to its gauges.
"""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from stepblocks.contact.operating_point import PAPER
from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.effects.gauges import GAUGE_LAWS
from stepblocks.rig.effects.offered import list_offered_laws
from stepblocks.rig.forward import SPEED_OVER_LOAD
from stepblocks.rig.state import DragState, Floats, press_edge

_geometry = partial(Law, slot="contact_geometry")


_GEOMETRY = (
    _geometry(
        "edge_rounding",
        "a = arccos(1 - H / (R + r))",
        (Parameter("edge_radius_m", "m", 0.0, 0.0, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["edge_radius_m"]),
        description="edges are rounded: r =",
        how_to_decide="scan the edges, or drag the same blocks with another tip",
    ),
    _geometry(
        "tip_wear",
        "R(n) = R + w n",
        (Parameter("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
        lambda state, order, v: state.changed(
            radius=state.radius + v["growth_m_per_trial"] * order
        ),
        covariate="run_order",
        description="the tip wears: its radius grows per trial by",
        how_to_decide="swap the tip",
    ),
    _geometry(
        "edge_polish",
        "r(n) = r + w n, n passes over the block",
        (Parameter("growth_m_per_pass", "m", 0.0, -5e-6, 2e-5, 1e-7),),
        lambda state, passes, v: state.changed(
            radius=state.radius + v["growth_m_per_pass"] * passes
        ),
        covariate="passes_of_block",
        rank=1,
        description="each pass polishes the edge of its block: the radius grows by",
        how_to_decide="scan an edge before and after, or drag a block that nobody has used",
    ),
    _geometry(
        "tip_radius_error",
        "R -> R + w; the same as a rounded edge, which a scan must rule out",
        (Parameter("radius_error_m", "m", 0.0, -1e-4, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["radius_error_m"]),
        rank=1,
        description="the radius of the tip differs from the stated one by",
        how_to_decide="swap the tip, or measure it",
    ),
    _geometry(
        # the ball rides lower by the depth of the flat, and every step stands higher by it
        "tip_flat",
        "a = arccos(1 - (H + d) / R), flat of half width sqrt(2 R d)",
        (Parameter("flat_depth_m", "m", 0.0, 0.0, 3e-5, 1e-6),),
        lambda state, _, v: state.changed(height=state.height + v["flat_depth_m"]),
        rank=1,
        description="the tip has a flat, of a depth of",
        how_to_decide="swap the tip",
    ),
    _geometry(
        # along the drag: the same as friction tan(atan mu + t), for every force and energy
        "block_tilt",
        "a -> a + t",
        (Parameter("tilt_rad", "rad", 0.0, -0.3, 0.3, 0.01),),
        lambda state, _, v: state.changed(tilt=state.tilt + v["tilt_rad"]),
        rank=5,
        description="the blocks are tilted by",
        how_to_decide="turn the blocks round: a tilt changes its sign",
    ),
    *(  # of a ball on the edge after Hertz, or of whatever holds block or tip
        _geometry(
            f"elastic_indentation{mark}",
            f"cos a = (R - H) / (R - d N^p), p = {power:.3g}, N = F_py cos(atan mu) / cos(a + "
            "atan mu) across the edge",
            (Parameter("depth_at_1n_m", "m", 0.0, -5e-6, 5e-5, 1e-6),),
            partial(lambda p, state, _, v: press_edge(state, v["depth_at_1n_m"], p), power),
            covariate="load_n",
            rank=rank,
            description="the contact gives way: depth at 1 N",
        )
        for mark, power, rank in (("", 2.0 / 3.0, 0), ("~linear", 1.0, 1))
    ),
)


def _make_height_error_law(block: str) -> Law:
    # Return the effect of a block far from its nominal height. Small errors are priors of the
    # nominal model.
    return _geometry(
        f"block_height_error~{block}",
        f"H -> H + h on {block}",
        (Parameter("height_error_m", "m", 0.0, -4e-5, 4e-5, 1e-6),),
        lambda state, blocks, v: state.changed(
            height=state.height + v["height_error_m"] * (blocks == block)
        ),
        covariate="block",
        description=f"the height of block {block} differs from the stated one by",
        how_to_decide=f"scan or gauge the block {block}",
    )


_friction = partial(Law, slot="friction")
_by_speed = partial(
    _friction,
    covariate="speed_mm_s",
    description="friction falls with speed: excess at rest {}, over a speed of {}",
)

_FRICTION = (
    _friction(
        "load_dependent_friction",  # an elastic contact after Hertz has p = 1/3
        "mu (F_py / 0.6 N)^-p",
        (Parameter("exponent", "1", 0.0, -3.0, 3.0, 0.05),),
        lambda state, _, v: state.changed(
            friction=state.friction * (state.load / 0.6) ** -v["exponent"]
        ),
        covariate="load_n",
        description="friction falls with load: exponent",
    ),
    _friction(
        "edge_friction",  # an edge is ground, coated or worn otherwise than the faces
        "e mu while the tip climbs, mu on the faces",
        (Parameter("edge_over_face", "1", 1.0, 0.1, 4.0, 0.03),),
        lambda state, _, v: state.changed(edge_factor=state.edge_factor * v["edge_over_face"]),
        description="friction on the edge over that on the faces is",
        how_to_decide="turn the blocks round, and drag a block with a fresh edge",
    ),
    _by_speed(
        "stribeck_friction",  # falls from rest to sliding
        "mu (1 + s exp(-v / v_s))",
        (
            Parameter("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Parameter("stribeck_speed_m_per_s", "m/s", 5e-3, 5e-4, 1e-1, 1e-3),
        ),
        lambda state, _, v: state.changed(
            friction=state.friction
            * (1.0 + v["excess"] * np.exp(-state.speed / v["stribeck_speed_m_per_s"]))
        ),
        shapes=tuple({"stribeck_speed_m_per_s": v} for v in (1.5e-3, 4e-3, 9e-3, 2.5e-2)),
    ),
    _by_speed(
        "stribeck_friction~logarithmic",  # the law of dry contacts
        "mu (1 + s ln(v / 6 mm/s))",
        (Parameter("slope", "1", 0.0, -2.0, 2.0, 0.03),),
        lambda state, _, v: state.changed(
            friction=state.friction
            * np.maximum(1.0 + v["slope"] * np.log(state.speed / 6e-3), 0.02)
        ),
        rank=1,
        description="friction goes with the logarithm of speed: slope",
    ),
    _friction(
        "hersey_friction",  # of a film that speed builds and load presses out
        "mu (1 + s exp(-(v / F_py) / h))",
        (
            Parameter("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Parameter("number", "m/(N s)", 8e-3, 5e-4, 2e-1, 1e-3),
        ),
        lambda state, ratio, v: state.changed(
            friction=state.friction * (1.0 + v["excess"] * np.exp(-1e-3 * ratio / v["number"]))
        ),
        covariate=SPEED_OVER_LOAD,
        shapes=tuple({"number": h} for h in (3e-3, 8e-3, 2e-2, 5e-2)),
        description="friction follows speed over load: excess at rest {}, over a ratio of {}",
    ),
    _friction(
        "hersey_friction~power",
        "mu ((v / F_py) / 0.01 m/(N s))^-p",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        lambda state, ratio, v: state.changed(
            friction=state.friction * (0.1 * ratio) ** -v["exponent"]
        ),
        covariate=SPEED_OVER_LOAD,
        rank=1,
        description="friction follows speed over load: exponent",
    ),
    _friction(
        "carried_over",
        "mu (F_before / 0.6 N)^p",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        lambda state, before, v: state.changed(
            friction=state.friction * (before / 0.6) ** v["exponent"]
        ),
        covariate="previous_load_n",
        description="friction follows the load of the trial before: exponent",
        how_to_decide="repeat one trial after a light and after a heavy one",
    ),
    *(  # of a fresh contact, and of one that a rest has changed
        _friction(
            name,
            f"mu (1 + s exp(-n / n0)){count}",
            (
                Parameter("excess", "1", 0.0, -0.95, 20.0, 0.05),
                Parameter("settling_trials", "1", start, least, 1000.0, 0.2 * start),
            ),
            lambda state, order, v: state.changed(
                friction=state.friction
                * np.maximum(1.0 + v["excess"] * np.exp(-order / v["settling_trials"]), 0.02)
            ),
            covariate=covariate,
            shapes=tuple({"settling_trials": start * n} for n in (0.3, 0.8, 2.0, 8.0)),
            description=f"friction {verb}: excess at first {{}}, trials to settle {{}}",
            how_to_decide=how,
        )
        for name, count, start, least, covariate, verb, how in (
            (
                "running_in",
                "",
                50.0,
                3.0,
                "run_order",
                "runs in",
                "drag a fresh or cleaned block: friction begins high again",
            ),
            (
                "rest",
                ", n trials since a rest",
                5.0,
                0.5,
                "trials_since_rest",
                "differs after a rest",
                "repeat one trial before and after a rest",
            ),
        )
    ),
)


_conversion = partial(Law, slot="conversion")


def _apply_motion(state: DragState, _: object, values: Mapping[str, float]) -> DragState:
    weight = values["weight"]
    if weight == 0.0:
        return state
    # compiled kernels, loaded where they are used
    from stepblocks.rig.effects.release_motion import (
        compute_release,
    )

    load = np.maximum(state.load, 1e-3)
    # k m = (k / omega)^2: the ring itself tells the mass that moves
    momentum = state.stiffness / (2.0 * np.pi * state.frequency)
    stiffness, speed = state.stiffness * state.radius / load, state.speed * momentum / load
    excess, share = compute_release(
        state.height / state.radius,
        state.friction,
        stiffness,
        speed,
        state.damping / (2.0 * np.pi * state.frequency * state.decay_time),
        np.maximum(state.hardening, 0.0) * load**2,
    )
    return state.changed(
        climb_load=state.climb_load + load * np.expm1(weight * excess),
        conversion=state.conversion * np.exp(weight * (share - np.log(PAPER.tool.conversion))),
    )


def _apply_work(state: DragState, _: object, values: Mapping[str, float]) -> DragState:
    reach = np.sqrt(np.maximum(state.height * (2.0 * state.radius - state.height), 0.0))
    work = state.load * (state.height + state.friction * reach)
    return state.changed(lost_energy=state.lost_energy + values["share"] * work)


_CONVERSION = (
    _conversion(
        "speed_dependent_conversion",
        "C_v (v / 6 mm/s)^q",
        (Parameter("exponent", "1", 0.0, -2.0, 2.0, 0.03),),
        lambda state, _, v: state.changed(
            conversion=state.conversion * (state.speed / 6e-3) ** v["exponent"]
        ),
        covariate="speed_mm_s",
        description="the share that rings follows the speed: exponent",
    ),
    _conversion(
        "temperature_dependent_conversion",
        "C_v exp(g (T - 22 C))",
        (Parameter("rate_per_k", "1/K", 0.0, -1.0, 1.0, 0.01),),
        lambda state, celsius, v: state.changed(
            conversion=state.conversion * np.exp(v["rate_per_k"] * (celsius - 22.0))
        ),
        covariate="temperature_c",
        description="the share that rings follows the temperature, per K by",
    ),
    # the tip has a mass that must be moved and lifted over the rest of the step while the handle
    # goes on; or, by energies alone, C_v less the work of lifting and rubbing
    _conversion(
        "real_release",
        "C_v and peak from (1 + T tan a) x'' = F - T (1 + y'' x'^2), T = tan(a + atan mu), to the "
        "power w",
        (Parameter("weight", "1", 0.0, 0.0, 1.5, 0.05),),
        _apply_motion,
        description="the tip must be moved and lifted over the step: weight of that motion",
    ),
    _conversion(
        "real_release~work",
        "E_v = C_v F_px^2 / 2k - s F_py (H + mu sqrt(H (2R - H)))",
        (Parameter("share", "1", 0.0, -1.0, 3.0, 0.02),),
        _apply_work,
        rank=1,
        description="the tip must be moved and lifted over the step: weight of that motion",
    ),
)


_stiffness, _load = (partial(Law, slot=slot) for slot in ("stiffness", "normal_load"))
_bias = partial(
    _load,
    description="the load differs from the weights by",
    how_to_decide="weigh the arm without weights",
)
_pivot = partial(
    _load,
    description="a pivot rubs while the tip is lifted: share of the load",
    how_to_decide="lift the arm slowly by a scale",
)
_drag = partial(
    Law,
    slot="drag",
    covariate="speed_mm_s",
    description="a viscous drag acts: coefficient",
    how_to_decide="drag without touching a block",
)

_BIAS = (Parameter("load_bias_n", "N", 0.0, -0.25, 0.6, 0.01),)
_COEFFICIENT = (Parameter("coefficient_n_s_per_m", "N s/m", 0.0, -20.0, 100.0, 0.5),)


_SOFTENING = Parameter("softening_per_k", "1/K", 0.0, -0.05, 0.05, 1e-3)
_softening = partial(
    _stiffness,
    covariate="temperature_c",
    how_to_decide="load the tool with a known weight, cold and warm",
)


def _compute_softening(celsius: Floats, values: Mapping[str, float]) -> Floats:
    return np.asarray(np.maximum(1.0 - values["softening_per_k"] * (celsius - 22.0), 0.1))


def _apply_softening(state: DragState, celsius: Floats, values: Mapping[str, float]) -> DragState:
    left = _compute_softening(celsius, values)
    return state.changed(
        stiffness=state.stiffness * left,
        ring_stiffness=state.ring_stiffness * left,
        damping=state.damping * left ** values["damping_power"],
    )


_TOOL = (
    _stiffness(
        "hardening_spring",  # after Duffing
        "F = u + g u^3, u = k x: energy (u^2/2 + g u^4/4) / k, ramp k (1 + 3 g u^2), pitch with "
        "3/4 g A^2 at amplitude A",
        (
            Parameter("cubic_per_n2", "1/N^2", 0.0, 0.0, 5.0, 0.02),
            # a ring that rubs has died away where its pitch is fitted best: what it shows of A^2 is
            # found with it
            Parameter("pitch_share", "1", 0.2, -0.5, 1.0, 0.1),
        ),
        lambda state, _, v: state.changed(
            hardening=state.hardening + v["cubic_per_n2"],
            pitch_share=state.pitch_share + v["pitch_share"],
        ),
        covariate="peak_force_n",
        given=False,
        shapes=({"pitch_share": 0.0}, {"pitch_share": 0.4}),
        description="the spring hardens: g {}, its pitch shows {} of the first swing",
    ),
    _softening(
        "softening_spring",
        "k (1 - s (T - 22 C)), rate of decay with the power q of k",
        (
            _SOFTENING,
            # a damper of oil keeps its coefficient (0), one of rubber its ratio (1/2)
            Parameter("damping_power", "1", 0.25, -1.0, 1.5, 0.1, 0.5),
        ),
        _apply_softening,
        shapes=({"damping_power": 0.0}, {"damping_power": 0.5}),
        description="the spring softens as it warms: by {}, its damping with the power {} of k",
    ),
    _softening(
        "softening_spring~pitch_unchanged",
        "k (1 - s (T - 22 C)) of the ramp alone",
        (_SOFTENING,),
        lambda state, celsius, v: state.changed(
            stiffness=state.stiffness * _compute_softening(celsius, v),
            conversion=state.conversion * _compute_softening(celsius, v),
        ),
        rank=1,
        description="the spring softens as it warms, though its pitch does not: per K by",
    ),
    _bias(
        "load_bias",
        "F_py -> F_py + b, as the gauge sees it",
        _BIAS,
        lambda state, _, v: state.changed(
            load=state.load + v["load_bias_n"], sensed_offset=state.sensed_offset + v["load_bias_n"]
        ),
    ),
    _bias(
        "load_bias~unseen",
        "F_py -> F_py + b at the contact, unseen by the gauge",
        _BIAS,
        lambda state, _, v: state.changed(load=state.load + v["load_bias_n"]),
        rank=1,
    ),
    _pivot(
        "pivot_friction",
        "F_py (1 + p) while the tip climbs",
        # what rubs presses on a tip that is lifted, and never carries it
        (Parameter("pivot_share", "1", 0.0, 0.0, 2.0, 0.02),),
        lambda state, _, v: state.changed(
            climb_load=state.climb_load + v["pivot_share"] * state.set_load
        ),
        rank=2,
    ),
    _pivot(
        "pivot_friction~constant",
        "F_py + f while the tip climbs",
        (Parameter("pivot_force_n", "N", 0.0, 0.0, 0.6, 0.01),),
        lambda state, _, v: state.changed(climb_load=state.climb_load + v["pivot_force_n"]),
        rank=3,
        description="a pivot rubs while the tip is lifted: force",
    ),
    _drag(
        "viscous_drag",
        "F_x + c v",
        _COEFFICIENT,
        lambda state, _, v: state.changed(
            drag=state.drag + v["coefficient_n_s_per_m"] * state.speed
        ),
    ),
    _drag(
        "viscous_drag~climbing",
        "F_px + c v, while the tip climbs",
        _COEFFICIENT,
        lambda state, _, v: state.changed(
            climb_drag=state.climb_drag + v["coefficient_n_s_per_m"] * state.speed
        ),
        rank=1,
    ),
)


def list_named_laws(blocks: Sequence[str] = ()) -> tuple[Law, ...]:
    """Return the laws that have names, the height error of each of `blocks` among them.

    Packages and users may offer their own, see `offered`. Laws without a name are in `smooth`.
    """
    return (
        *_GEOMETRY,
        *_FRICTION,
        *_TOOL,
        *_CONVERSION,
        *GAUGE_LAWS,
        *list_offered_laws(),
        *map(_make_height_error_law, blocks),
    )
