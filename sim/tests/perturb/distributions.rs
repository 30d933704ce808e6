//! Sampled values follow the distributions in docs/benchmark.md, "Perturbations".

use std::collections::BTreeMap;

use nalgebra::Vector3;
use sim::scene::{CameraMount, Mass, PlacementSpec, Range, Scene, Texture};
use sim::{Perturbation, Profile, TaskId};

use crate::common::{applies, nominal, perturbed, seeds};

const N: u32 = 10_000;

/// Asserts that the samples are uniform in `range`, by their bounds and by the Kolmogorov–Smirnov distance,
/// which exceeds 1.95 / √n in one of a thousand tests.
#[track_caller]
fn assert_uniform(what: &str, mut samples: Vec<f64>, range: Range) {
    let n = samples.len() as f64;
    samples.sort_unstable_by(f64::total_cmp);
    let (min, max) = (samples[0], samples[samples.len() - 1]);
    assert!(
        range.contains(min) && range.contains(max),
        "{what}: samples span [{min}, {max}], expected {range:?}"
    );
    let distance = |(i, x): (usize, &f64)| {
        let expected = (x - range.lo) / (range.hi - range.lo);
        (expected - i as f64 / n).abs().max((expected - (i + 1) as f64 / n).abs())
    };
    let distance = samples.iter().enumerate().map(distance).fold(0.0, f64::max);
    assert!(distance < 1.95 / n.sqrt(), "{what}: Kolmogorov–Smirnov distance {distance} over {n} samples");
}

/// Asserts that each of `n_choices` values occurs about equally often, by the chi-squared statistic, which
/// almost never exceeds its mean by five standard deviations.
#[track_caller]
fn assert_even<T: Ord>(what: &str, choices: impl Iterator<Item = T>, n_choices: usize) {
    let mut counts: BTreeMap<T, f64> = BTreeMap::new();
    choices.for_each(|choice| *counts.entry(choice).or_default() += 1.0);
    assert_eq!(counts.len(), n_choices, "{what}: number of distinct values");
    let expected = counts.values().sum::<f64>() / n_choices as f64;
    let chi_squared: f64 = counts.values().map(|count| (count - expected).powi(2) / expected).sum();
    let freedom = (n_choices - 1) as f64;
    assert!(chi_squared < freedom + 5.0 * (2.0 * freedom).sqrt(), "{what}: chi-squared {chi_squared}");
}

fn scenes(task: TaskId, perturbation: Perturbation) -> Vec<Scene> {
    let spec = perturbed(task, perturbation);
    seeds(task, N).map(|seed| spec.draw(seed)).collect()
}

const UNIT: Range = Range::new(0.0, 1.0);

#[test]
fn colours_are_uniform_and_never_repeat() {
    let scenes = scenes(TaskId::StackCube, Perturbation::MoColor);
    let color = |scene: &Scene| scene.body("red cube").parts[0].appearance.color;
    for channel in 0..3 {
        assert_uniform("MO-Color", scenes.iter().map(|scene| color(scene)[channel]).collect(), UNIT);
    }
    let mut colors: Vec<[u64; 3]> = scenes.iter().map(|scene| color(scene).map(f64::to_bits)).collect();
    colors.sort_unstable();
    colors.dedup();
    assert_eq!(colors.len(), N as usize, "two episodes share a colour");
}

#[test]
fn parts_have_independent_colours_and_textures() {
    // The bodies are two cubes and a goal disc of five rings.
    let task = TaskId::DualArmStackCube;
    let appearances = |scene: &Scene| -> Vec<_> {
        let parts = scene.bodies.iter().flat_map(|body| &body.parts);
        parts.map(|part| part.appearance).collect()
    };
    let mut same_texture = 0_usize;
    for seed in seeds(task, 200) {
        let painted = appearances(&perturbed(task, Perturbation::RoColor).draw(seed));
        let rings = &painted[2..];
        assert!(rings.iter().enumerate().all(|(i, a)| rings[..i].iter().all(|b| a.color != b.color)));
        let textured = appearances(&perturbed(task, Perturbation::MoTexture).draw(seed));
        let [a, b] = [0, 1].map(|cube| textured[cube].texture.expect("MO-Texture textures every part"));
        same_texture += usize::from(a == b);
    }
    assert!(same_texture < 200 / 10, "the two cubes share a texture in {same_texture} of 200 episodes");
}

#[test]
fn textures_are_uniform_and_untinted() {
    let scenes = scenes(TaskId::RaiseCube, Perturbation::MoTexture);
    let appearances: Vec<_> = scenes.iter().map(|scene| scene.body("cube").parts[0].appearance).collect();
    assert!(appearances.iter().all(|appearance| appearance.color == [1.0; 3]));
    let choices = appearances
        .iter()
        .map(|appearance| format!("{:?}", appearance.texture.expect("MO-Texture textures every part")));
    assert_even("MO-Texture", choices, Texture::PERTURBATION.len());
}

#[test]
fn recoloured_table_has_one_colour_and_no_texture() {
    for (task, n_colors) in [(TaskId::RaiseCube, 1), (TaskId::DualArmLiftPot, 2)] {
        for seed in seeds(task, 50) {
            let table = perturbed(task, Perturbation::TableColor).draw(seed).table;
            let appearances: Vec<_> = [table.top, table.legs].into_iter().chain(table.lower_top).collect();
            assert!(appearances.iter().all(|appearance| appearance.texture.is_none()));
            let mut colors: Vec<_> =
                appearances.iter().map(|appearance| appearance.color.map(f64::to_bits)).collect();
            colors.sort_unstable();
            colors.dedup();
            assert_eq!(colors.len(), n_colors, "{}: number of table colours", task.name());
        }
    }
}

#[test]
fn coin_flip_selects_colour_or_texture_under_all() {
    let scenes = scenes(TaskId::RaiseCube, Perturbation::All);
    let has_texture = |scene: &Scene| {
        let walls = scene.background.walls.expect("varied walls exist");
        [scene.body("cube").parts[0].appearance, scene.table.top, walls]
            .map(|appearance| appearance.texture.is_some())
    };
    let outcomes: Vec<[bool; 3]> = scenes.iter().map(has_texture).collect();
    for (i, what) in ["cube", "table", "walls"].into_iter().enumerate() {
        assert_even(what, outcomes.iter().map(|outcome| outcome[i]), 2);
    }
    // Each appearance has a coin flip of its own.
    assert_even("joint outcomes of three coin flips", outcomes.iter(), 8);
}

#[test]
fn sizes_vary_uniformly_by_a_fifth() {
    for (task, perturbation) in
        [(TaskId::RaiseCube, Perturbation::MoSize), (TaskId::CookItemInPan, Perturbation::RoSize)]
    {
        let by = nominal(task)
            .bodies
            .iter()
            .zip(&perturbed(task, perturbation).bodies)
            .find(|(nominal, perturbed)| nominal.scale != perturbed.scale)
            .map(|(body, _)| body.name);
        let name = by.expect("the perturbation scales a body");
        let scales = scenes(task, perturbation).iter().map(|scene| scene.body(name).scale.x).collect();
        assert_uniform(perturbation.name(), scales, Range::new(0.8, 1.2));
    }
}

#[test]
fn scaled_body_keeps_its_density() {
    let spec = perturbed(TaskId::RaiseCube, Perturbation::MoSize);
    for seed in seeds(TaskId::RaiseCube, 10) {
        let scene = spec.draw(seed);
        assert_eq!(scene.body("cube").mass, Mass::Density(1000.0));
    }
}

#[test]
fn light_colour_and_azimuth_are_uniform() {
    let scenes = scenes(TaskId::RaiseCube, Perturbation::LightColor);
    assert!(scenes.iter().all(|scene| scene.lights.shadows && scene.lights.directional.len() == 1));
    for channel in 0..3 {
        let ambient = scenes.iter().map(|scene| scene.lights.ambient[channel]).collect();
        assert_uniform("ambient", ambient, Range::new(0.15, 0.45 + 1e-15));
        let color = scenes.iter().map(|scene| scene.lights.directional[0].color[channel]).collect();
        assert_uniform("directional", color, Range::new(0.5, 1.0));
    }
    let directions = scenes.iter().map(|scene| Vector3::from(scene.lights.directional[0].direction));
    let azimuths = directions.map(|direction| {
        assert!((direction.xy().norm() - 1.0).abs() < 1e-12 && direction.z == -1.0, "the elevation is 45°");
        libm::atan2(direction.y, direction.x)
    });
    let half_turn = core::f64::consts::PI;
    assert_uniform("azimuth", azimuths.collect(), Range::new(-half_turn, half_turn));
}

#[test]
fn only_external_cameras_have_pose_errors() {
    let scenes = scenes(TaskId::RaiseCube, Perturbation::CameraPose);
    for camera_idx in 0..2 {
        let errors: Vec<_> = scenes.iter().map(|scene| scene.cameras[camera_idx].pose_error).collect();
        for axis in 0..3 {
            let shifts = errors.iter().map(|error| error.translation.vector[axis]).collect();
            assert_uniform("shift", shifts, Range::symmetric(0.03));
        }
        // The intrinsic XYZ angles of R are the negated roll, pitch and yaw of its inverse.
        let angles: Vec<_> = errors.iter().map(|error| error.rotation.inverse().euler_angles()).collect();
        let range = Range::symmetric(0.035 + 1e-12);
        assert_uniform("about x", angles.iter().map(|angles| -angles.0).collect(), range);
        assert_uniform("about y", angles.iter().map(|angles| -angles.1).collect(), range);
        assert_uniform("about z", angles.iter().map(|angles| -angles.2).collect(), range);
    }
    let hand_cameras = scenes.iter().flat_map(|scene| &scene.cameras[2..]);
    assert!(hand_cameras.clone().count() > 0);
    for camera in hand_cameras {
        assert!(matches!(camera.mount, CameraMount::Hand { .. }));
        assert_eq!(camera.pose_error, nalgebra::Isometry3::identity());
    }
    assert!(scenes.iter().all(|scene| scene.cameras[0].pose_error != scene.cameras[1].pose_error));
}

#[test]
fn paper_profile_raises_cameras_by_three_centimetres() {
    let task = TaskId::RaiseCube.task();
    let spec = Perturbation::CameraPose.apply(
        (task.nominal)(Profile::Strict),
        task,
        Profile::Paper,
        sim::perturb::Strength::FULL,
    );
    for seed in seeds(TaskId::RaiseCube, 100) {
        let scene = spec.draw(seed);
        assert!(scene.cameras[..2].iter().all(|camera| camera.pose_error.translation.z == 0.03));
    }
}

/// Expected x and y ranges under Pose-Randomization of the first body placed in each region, shared offset
/// included. See docs/benchmark.md, "Perturbations".
const EXPECTED_RANGES: [(TaskId, &str, [[f64; 2]; 2]); 31] = {
    use TaskId as T;
    [
        (T::RaiseCube, "cube", [[-0.15, 0.15], [-0.15, 0.15]]),
        (T::LiftPegUpright, "peg", [[-0.15, 0.15], [-0.15, 0.15]]),
        (T::DualArmCubeHandover, "cube", [[-0.15, 0.15], [-0.15, 0.15]]),
        (T::DualArmLiftPot, "pot", [[-0.15, 0.15], [-0.15, 0.15]]),
        (T::DualArmLiftTray, "tray", [[-0.15, 0.15], [-0.15, 0.15]]),
        (T::PlaceBookInShelf, "book", [[-0.225, -0.075], [-0.45, -0.15]]),
        (T::PlaceBookInShelf, "shelf", [[0.05, 0.15], [-0.45, -0.15]]),
        (T::PlaceDishInRack, "plate", [[-0.45, -0.15], [-0.35, -0.05]]),
        (T::RotateArrow, "arrow", [[-0.45, -0.15], [-0.35, -0.05]]),
        (T::PegInsertionSide, "peg", [[-0.15, 0.15], [-0.375, 0.075]]),
        (T::PegInsertionSide, "box", [[-0.075, 0.075], [0.15, 0.45]]),
        (T::PlugCharger, "charger", [[-0.1185, -0.0075], [-0.3, 0.3]]),
        (T::HammerNail, "hammer", [[-0.145, -0.055], [0.305, 0.395]]),
        (T::ScoopBanana, "dustpan", [[-0.35, -0.05], [-0.35, -0.05]]),
        (T::OpenDrawer, "cabinet", [[0.125, 0.275], [-0.075, 0.075]]),
        (T::OpenCabinet, "cabinet", [[0.125, 0.275], [-0.075, 0.075]]),
        (T::PlaceCubeInDrawer, "cube", [[-0.15, 0.15], [0.35, 0.65]]),
        (T::PlaceCubeInDrawer, "cabinet", [[-0.15, 0.15], [-0.65, -0.4]]),
        (T::CookItemInPan, "apple", [[-0.24, 0.0], [-0.32, -0.08]]),
        (T::CookItemInPan, "pan", [[-0.075, 0.005], [-0.075, 0.075]]),
        (T::DualArmBottleHandover, "bottle", [[0.15, 0.45], [-0.35, -0.05]]),
        (T::DualArmPushBox, "box", [[-0.25, 0.05], [-0.15, 0.15]]),
        (T::DualArmPourPot, "pot", [[0.025, 0.175], [-0.15, 0.15]]),
        (T::DualArmThreading, "tripod", [[0.125, 0.275], [-0.075, 0.075]]),
        (T::DualArmThreading, "needle", [[-0.375, -0.225], [-0.075, 0.075]]),
        (T::DualArmPenCap, "cap", [[-0.475, -0.025], [-0.475, -0.025]]),
        (T::DualArmDrawerPlace, "cube", [[-0.225, -0.075], [-0.14175, -0.14025]]),
        (T::DualArmStackCube, "red cube", [[-0.1, 0.2], [-0.225, -0.075]]),
        (T::DualArmStackCube, "green cube", [[-0.075, 0.075], [0.075, 0.225]]),
        (T::DualArmStackTwoCubes, "red cube", [[-0.05, 0.25], [-0.225, -0.075]]),
        (T::DualArmStackTwoCubes, "green cube", [[0.075, 0.225], [0.075, 0.225]]),
    ]
};

#[test]
fn regions_are_widened_by_half() {
    for (task, name, [x, y]) in EXPECTED_RANGES {
        let spec = perturbed(task, Perturbation::PoseRandomization);
        let PlacementSpec::OnSurface { region, .. } = spec.bodies[spec.body_idx(name)].placement else {
            panic!("{name} is placed relative to another body")
        };
        // Rejection sampling makes positions non-uniform.
        let is_uniform = spec.regions[region].min_gap_m.is_none() && spec.min_start_gap_m.is_none();
        let scenes: Vec<Scene> =
            seeds(task, if is_uniform { N } else { 1000 }).map(|seed| spec.draw(seed)).collect();
        for (axis, [lo, hi]) in [x, y].into_iter().enumerate() {
            let what = format!("{} {name} axis {axis}", task.name());
            let at = scenes.iter().map(|scene| scene.body(name).pose.translation.vector[axis]);
            let range = Range::new(lo - 1e-12, hi + 1e-12);
            if is_uniform {
                assert_uniform(&what, at.collect(), range);
            } else {
                at.for_each(|at| assert!(range.contains(at), "{what}: {at}"));
            }
        }
    }
}

#[test]
fn book_starts_clear_of_the_bookcase() {
    let task = TaskId::PlaceBookInShelf;
    for spec in [nominal(task), perturbed(task, Perturbation::PoseRandomization)] {
        for scene in seeds(task, 200).map(|seed| spec.draw(seed)) {
            let [book, shelf] = ["book", "shelf"].map(|name| {
                let body = scene.body(name);
                body.aabb(&body.pose)
            });
            let gap = (book.min - shelf.max).sup(&(shelf.min - book.max)).max();
            assert!(gap > 0.005 - 1e-12, "{gap} m");
        }
    }
}

#[test]
fn excluded_regions_and_bodies_are_unchanged() {
    for &task in TaskId::ALL.iter().filter(|task| applies(Perturbation::PoseRandomization, **task)) {
        let (spec, nominal) = (perturbed(task, Perturbation::PoseRandomization), nominal(task));
        for (region, before) in spec.regions.iter().zip(&nominal.regions) {
            if before.widened.is_none() {
                assert_eq!(region, before, "{}", task.name());
            }
        }
        assert_eq!(spec.bodies, nominal.bodies, "{}: bodies changed", task.name());
    }
}
