//! The stove and the frying pan. See docs/benchmark.md, "Scenes and objects".

use nalgebra::{Isometry3, Translation3, Vector3};

use super::vessel::Vessel;
use super::{SINGLE_TABLE_Z, box_part, movable, rgb};
use crate::expert::{Move, grasp};
use crate::scene::{
    AppearanceSpec, BodySpec, Mass, Motion, PartSpec, Primitive, Role, ScaledBy, Scene, VisualShape,
    VisualSpec, rounded_rectangle,
};

/// Corners of the stove's bounding box in its own frame, smallest coordinates first, in m.
pub(in crate::tasks) const STOVE: [[f64; 3]; 2] = [[-0.139, -0.265, 0.0], [0.186, 0.178, 0.047]];
/// Centres (x, y) of the burners in the stove's frame, in m.
pub(in crate::tasks) const BURNERS: [[f64; 2]; 2] = [[-0.03, 0.0565], [-0.03, -0.1435]];
/// Radius of a burner and its height above the stove's body, in m.
const BURNER: [f64; 2] = [0.085, 0.006];
/// x of the knobs, which are visual only, in m.
const KNOB_X: f64 = 0.13;

/// Centre of the pan's base in its own frame, in m. The origin is a corner of the bounding box of pan and
/// handle.
pub(in crate::tasks) const PAN_CENTRE: [f64; 3] = [0.423, 0.108, 0.0018];
/// The pan's bowl.
pub(in crate::tasks) const PAN: Vessel = Vessel { radii: [0.088, 0.108], height: 0.0307, thickness: 0.004 };
/// Range of x covered by the pan's handle in its own frame, in m.
const HANDLE_X: [f64; 2] = [0.185, 0.324];
/// Half of the handle's width and half of its thickness, in m.
const HANDLE_HALF: [f64; 2] = [0.011, 0.007];

/// Creates a fixed stove with two burners.
pub(in crate::tasks) fn stove(region: usize) -> BodySpec {
    let steel = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(rgb([196, 198, 200])) };
    let iron = AppearanceSpec::plain(rgb([38, 38, 40]));
    let [min, max] = STOVE;
    let [radius, burner_height] = BURNER;
    let [hx, hy, half_height] = core::array::from_fn(|k| (max[k] - min[k]) / 2.0);
    let [x, y, _] = core::array::from_fn(|k| f64::midpoint(min[k], max[k]));
    let half_z = half_height - burner_height / 2.0;
    let burner_z = max[2] - burner_height / 2.0;
    let burner = |[x, y]: [f64; 2]| {
        let half_height = burner_height / 2.0;
        PartSpec::at(Primitive::Cylinder { radius, half_height }, [x, y, burner_z], iron)
    };
    let body = VisualShape::RoundedBox { half: [hx, hy, half_z], edge_radius: 0.01 };
    let mut visuals = vec![VisualSpec::at(body, [x, y, half_z], steel)];
    for [x, y] in BURNERS {
        let ring = |major_radius, minor_radius, appearance| {
            VisualSpec::at(VisualShape::Torus { major_radius, minor_radius }, [x, y, burner_z], appearance)
        };
        let coils =
            [0.025, 0.04, 0.055, 0.07].map(|major_radius| ring(major_radius, burner_height / 2.0, iron));
        let knob =
            VisualShape::Primitive(Primitive::Cylinder { radius: 0.016, half_height: burner_height / 2.0 });
        let knob = VisualSpec::at(knob, [KNOB_X, y, burner_z], iron);
        visuals.extend(coils.into_iter().chain([ring(radius, burner_height / 2.0, steel), knob]));
    }
    BodySpec {
        role: Role::ReceiverObject,
        motion: Motion::Fixed,
        scaled_by: ScaledBy::RoSize,
        visuals,
        ..movable(
            "stove",
            [box_part([hx, hy, half_z], [x, y, half_z], steel)]
                .into_iter()
                .chain(BURNERS.map(burner))
                .collect(),
            region,
            SINGLE_TABLE_Z,
        )
    }
}

/// Creates a frying pan whose handle points towards −x.
pub(in crate::tasks) fn pan(region: usize) -> BodySpec {
    let iron = AppearanceSpec { specular: 0.4, ..AppearanceSpec::plain(rgb([62, 64, 68])) };
    let grip = AppearanceSpec::plain(rgb([24, 24, 26]));
    let [min, max] = HANDLE_X;
    let [half_width, half_z] = HANDLE_HALF;
    let half_x = (max - min) / 2.0;
    let at = [f64::midpoint(min, max), PAN_CENTRE[1], PAN_CENTRE[2] + PAN.height - half_z];
    let hole =
        rounded_rectangle([0.009, 0.004], 0.0039).iter().map(|[x, y]| [x + 0.018 - half_x, *y]).collect();
    let handle = VisualShape::Extrusion {
        outline: rounded_rectangle([half_x, half_width], 0.01),
        holes: vec![hole],
        half_height: half_z,
    };
    let middle = Translation3::from(PAN_CENTRE);
    let mut bowl = PAN.visual(0.006, iron);
    bowl.pose = middle * bowl.pose;
    let mut parts = PAN.parts(iron);
    for part in &mut parts {
        part.pose = middle * part.pose;
    }
    parts.push(box_part([half_x, half_width, half_z], at, grip));
    BodySpec {
        visuals: vec![bowl, VisualSpec::at(handle, at, grip)],
        mass: Mass::Density(300.0),
        ..movable("pan", parts, region, SINGLE_TABLE_Z)
    }
}

/// Candidate lean angles of the hand, in rad.
const LEANS: [f64; 3] = [0.0, 0.3, 0.6];

/// Plans to grasp an object at `place` from above, with the fingers closing along x, carry it by `offset` and
/// release it. Both vectors are in the world, in m.
pub(in crate::tasks) fn carry(scene: &Scene, place: Vector3<f64>, offset: Vector3<f64>) -> Vec<Move> {
    let at_height =
        |tcp: &Isometry3<f64>, z: f64| grasp::translated(tcp, &(Vector3::z() * (z - tcp.translation.z)));
    let waypoints = |tcp: &Isometry3<f64>| {
        let there = grasp::translated(tcp, &offset);
        [at_height(tcp, 0.15), *tcp, at_height(tcp, 0.25), at_height(&there, 0.25), there]
    };
    let upright = [1.0, -1.0].map(|sign| grasp::pose(&place, &-Vector3::z(), &(Vector3::x() * sign)));
    let leaning = |tcp| LEANS.map(|lean| grasp::tilted_toward_base(scene, 0, tcp, lean));
    let candidates: Vec<_> = upright.iter().flat_map(leaning).collect();
    let tcp = grasp::first_reachable(scene, 0, &candidates, waypoints);
    let [above, at, raised, over, there] = waypoints(&tcp).map(|tcp| Move::straight(0, tcp));
    vec![above, at, Move::close(&[0], 6), raised, over.clone(), there, Move::open(&[0], 6), over]
}
