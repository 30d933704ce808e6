//! The profile `paper` starts and judges episodes as the released code does.

use core::f64::consts::{FRAC_PI_2, PI};

use ipc_types::ControlMode;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use sim::perturb::{Composition, Strength};
use sim::physics::World;
use sim::predicate::first_unmet;
use sim::scene::{Role, Scene, SceneSpec};
use sim::{Perturbation, Profile, TaskId};

use crate::common::seeds;

fn spec(task: TaskId, profile: Profile, perturbation: Perturbation) -> SceneSpec {
    Composition::from(perturbation).spec(task.task(), profile, Strength::FULL)
}

#[test]
fn applicability_does_not_depend_on_the_profile() {
    for task in TaskId::ALL {
        let nominals = [Profile::Strict, Profile::Paper].map(task.task().nominal);
        for perturbation in Perturbation::ALL {
            let [strict, paper] = nominals.each_ref().map(|nominal| perturbation.applies_to(nominal));
            assert_eq!(strict, paper, "{} {}", task.name(), perturbation.name());
        }
    }
}

#[test]
fn paper_profile_widens_regions_as_released() {
    let expected = [
        (TaskId::OpenCabinet, "cabinet", [[0.125, 0.275], [0.0, 0.0]]),
        (TaskId::PlaceCubeInDrawer, "cabinet", [[-0.15, 0.15], [-0.65, -0.35]]),
        (TaskId::CookItemInPan, "pan", [[0.0, 0.0], [0.0, 0.0]]),
        (TaskId::CookItemInPan, "apple", [[-0.24, 0.0], [-0.32, -0.08]]),
    ];
    for (task, name, ranges) in expected {
        let spec = spec(task, Profile::Paper, Perturbation::PoseRandomization);
        let region = spec.regions.iter().find(|region| region.name == name).unwrap();
        for (range, [lo, hi]) in [region.x, region.y].into_iter().zip(ranges) {
            assert!((range.lo - lo).abs() < 1e-12 && (range.hi - hi).abs() < 1e-12, "{task:?}: {range:?}");
        }
    }
}

/// Returns the gap between the bounding boxes of two bodies, in m; it is negative if they overlap.
fn gap_m(scene: &Scene, names: [&str; 2]) -> f64 {
    let [a, b] = names.map(|name| {
        let body = scene.body(name);
        body.aabb(&body.pose)
    });
    (a.min - b.max).sup(&(b.min - a.max)).max()
}

#[test]
fn only_paper_profile_lets_bodies_start_inside_others() {
    use Perturbation as P;
    use TaskId as T;
    // Share of the episodes under `paper`, measured over 400 seeds.
    let expected = [
        (T::PlaceBookInShelf, P::None, ["book", "shelf"], 0.56),
        (T::ScoopBanana, P::None, ["banana", "dustpan"], 0.12),
        (T::PegInsertionSide, P::None, ["peg", "box"], 0.02),
        (T::CookItemInPan, P::PoseRandomization, ["apple", "stove"], 0.06),
        (T::DualArmPourPot, P::PoseRandomization, ["pot", "tray"], 0.35),
    ];
    for (task, perturbation, names, expected) in expected {
        let [strict, paper] = [Profile::Strict, Profile::Paper].map(|profile| {
            let spec = spec(task, profile, perturbation);
            let overlaps = |seed: &u64| gap_m(&spec.draw(*seed), names) < -0.005;
            seeds(task, 400).filter(overlaps).count() as f64 / 400.0
        });
        assert!((paper - expected).abs() < 0.01, "{}: {paper}", task.name());
        // The box about a banana is larger than the banana.
        assert!(strict <= 0.005, "{}: {strict}", task.name());
    }
}

#[test]
fn banana_drops_beside_a_wall_on_the_table() {
    let spec = spec(TaskId::ScoopBanana, Profile::Paper, Perturbation::MoSize);
    for scene in seeds(TaskId::ScoopBanana, 50).map(|seed| spec.draw(seed)) {
        let [banana, wall] = ["banana", "wall"].map(|name| scene.body(name));
        assert_eq!(banana.pose.translation.z, 0.045);
        let at = wall.aabb(&wall.pose);
        assert!(at.min.z <= 0.0 && (at.max.z - 0.2).abs() < 1e-12, "the wall ends at {} m", at.max.z);
    }
}

#[test]
fn distractors_drop_from_the_released_height() {
    let expected = [
        (TaskId::HammerNail, 0.25 + 0.1),
        (TaskId::PlaceCubeInDrawer, 0.25 + 0.035),
        (TaskId::CookItemInPan, 0.25),
        (TaskId::DualArmDrawerOpen, 0.25),
    ];
    for (task, z) in expected {
        let spec = spec(task, Profile::Paper, Perturbation::DistractorObjects);
        let scene = spec.draw(0);
        let dropped: Vec<_> = scene.bodies.iter().filter(|body| body.role == Role::Distractor).collect();
        assert_eq!(dropped.len(), 2, "{}", task.name());
        for body in dropped {
            assert!((body.pose.translation.z - z).abs() < 1e-3, "{}: {}", task.name(), body.pose.translation);
        }
    }
}

/// Returns `true` if a peg counts that stands on its end and leans by an angle (rad) about a world axis.
fn peg_counts(profile: Profile, axis: UnitVector3<f64>, lean: f64) -> bool {
    let task = TaskId::LiftPegUpright.task();
    let mut scene = (task.nominal)(profile).draw(0);
    let peg = scene.body_idx("peg");
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let upright = about(Vector3::y_axis(), -FRAC_PI_2) * scene.bodies[peg].pose.rotation;
    let mut pose = Isometry3::from_parts(Translation3::identity(), about(axis, lean) * upright);
    pose.translation.z = -scene.bodies[peg].aabb(&pose).min.z;
    scene.bodies[peg].pose = pose;
    let world = World::build(&scene, ControlMode::JointPos);
    first_unmet(&(task.success)(&scene, profile), &world).is_none()
}

#[test]
fn leaning_peg_counts_by_its_third_euler_angle() {
    let cases = [
        // Axis and angle of the lean, and whether `strict` and `paper` count it.
        (Vector3::x_axis(), 0.0, [true, true]),
        (Vector3::x_axis(), 0.07, [true, true]),
        (Vector3::x_axis(), 25.0_f64.to_radians(), [false, true]),
        (Vector3::x_axis(), 35.0_f64.to_radians(), [false, false]),
        (Vector3::y_axis(), 0.07, [true, true]),
        (Vector3::y_axis(), 25.0_f64.to_radians(), [false, false]),
        (Vector3::x_axis(), PI, [true, true]),
    ];
    for (axis, lean, expected) in cases {
        let counted = [Profile::Strict, Profile::Paper].map(|profile| peg_counts(profile, axis, lean));
        assert_eq!(counted, expected, "leaning by {lean} rad about {axis:?}");
    }
}

#[test]
fn worlds_stay_finite_when_bodies_start_inside_others() {
    for task in [TaskId::PlaceBookInShelf, TaskId::PlaceCubeInDrawer, TaskId::CookItemInPan] {
        let spec = spec(task, Profile::Paper, Perturbation::PoseRandomization);
        for seed in seeds(task, 10) {
            let mut world = World::build(&spec.draw(seed), ControlMode::JointPos);
            let mut row = [1.0; 8];
            row[..7].copy_from_slice(&world.qpos(0)[..7]);
            (0..20).for_each(|_| world.step(&row));
            assert!(world.is_finite(), "{}", task.name());
        }
    }
}
