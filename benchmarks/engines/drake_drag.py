"""Drag a ball over an exported URDF or SDFormat block in Drake and print the peak force: python drake_drag.py FOLDER [block.sdf]."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from pydrake.geometry import AddContactMaterial, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, DiscreteContactApproximation
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

TIME_STEP = 2e-5
APPROACH = 30e-6  # before the notch, unscaled [m]


def main() -> None:
    folder = Path(sys.argv[1])
    scene = json.loads((folder / "event.json").read_text(encoding="utf-8"))
    name = sys.argv[2] if len(sys.argv) > 2 else "block.urdf"
    print(json.dumps(drag(folder / name, scene, scene["events"][0])))


def drag(block: Path, scene: dict, event: dict) -> dict:
    """Hang the ball on two prismatic joints; spring and load are forces on them."""
    radius, scale, stiffness, load = (
        scene[key] for key in ("ball_radius_m", "scale", "stiffness_n_per_m", "normal_load_n")
    )
    builder = DiagramBuilder()
    plant, graph = AddMultibodyPlantSceneGraph(builder, TIME_STEP)
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
    friction = CoulombFriction(scene["friction"], scene["friction"])
    plant.SetUseSampledOutputPorts(False)
    for model in Parser(plant).AddModels(str(block)):
        if block.suffix == ".urdf":  # a static SDFormat model is welded to the world by itself
            plant.WeldFrames(plant.world_frame(), plant.get_body(plant.GetBodyIndices(model)[0]).body_frame())
    probe = plant.AddModelInstance("probe")
    slide = plant.AddRigidBody("slide", probe, SpatialInertia(1e-9, np.zeros(3), UnitInertia.SolidSphere(radius)))
    tip = plant.AddRigidBody(
        "tip", probe, SpatialInertia(scene["tip_mass_kg"], np.zeros(3), UnitInertia.SolidSphere(radius))
    )
    base = plant.AddFrame(FixedOffsetFrame("rest", plant.world_frame(), RigidTransform([0.0, 0.0, radius])))
    across = plant.AddJoint(PrismaticJoint("x", base, slide.body_frame(), [1, 0, 0], damping=0.5 / scale))
    down = plant.AddJoint(PrismaticJoint("z", slide.body_frame(), tip.body_frame(), [0, 0, 1]))
    pull, press = plant.AddJointActuator("pull", across), plant.AddJointActuator("press", down)
    proximity = ProximityProperties()
    AddContactMaterial(friction=friction, point_stiffness=1e7 / scale, dissipation=50.0, properties=proximity)
    plant.RegisterCollisionGeometry(tip, RigidTransform(), Sphere(radius), "ball", proximity)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    plant.Finalize()
    inspector = graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds():  # URDF has no place for friction and stiffness
        if inspector.GetProximityProperties(geometry) is not None and inspector.GetName(geometry).find("ball") < 0:
            properties = ProximityProperties(inspector.GetProximityProperties(geometry))
            properties.UpdateProperty("material", "coulomb_friction", friction)
            properties.UpdateProperty("material", "point_contact_stiffness", 1e7 / scale)
            graph.AssignRole(plant.get_source_id(), geometry, properties, assign=replace_role())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    start = event["trigger_position_m"] - APPROACH * scale
    across.set_translation(context, start)
    down.set_translation(context, event["trigger_height_m"] - radius)
    formula = event["critical_force_n"]
    target = formula or 10.0 * load
    speed = 1e-3 * scale * min(1.0, target)
    travel = APPROACH * scale + 1.15 * target / stiffness + 0.3 * radius
    steps, peak, settle = int(np.ceil(travel / speed / TIME_STEP)), 0.0, 500
    effort = np.zeros(2)
    for step in range(-settle, steps):
        hand = start + speed * max(step, 0) * TIME_STEP
        spring = stiffness * (hand - across.get_translation(context))
        peak = max(peak, spring) if step >= 0 else 0.0
        pull.set_actuation_vector([spring], effort)
        press.set_actuation_vector([-load], effort)
        plant.get_actuation_input_port().FixValue(context, effort)
        simulator.AdvanceTo((step + settle + 1) * TIME_STEP)
    crossed = across.get_translation(context) - event["trigger_position_m"] > 0.2 * radius
    return {"peak_force_n": peak, "formula_n": formula, "crossed": bool(crossed), "steps": steps}


def replace_role() -> object:
    from pydrake.geometry import RoleAssign

    return RoleAssign.kReplace


if __name__ == "__main__":
    main()
