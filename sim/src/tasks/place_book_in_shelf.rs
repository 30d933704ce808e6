//! PlaceBookInShelf: put a book next to others in a bookcase. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::{UnitQuaternion, Vector3};

use super::common::objects::book;
use super::common::furniture::bookcase;
use super::common::{ExternalCameras, SINGLE_TABLE_Z, fixed, movable, region, single_arm};
use crate::expert::{Move, TcpGoal, grasp};
use crate::predicate::{Predicate, Region};
use crate::task::profile::{Profile, ProfileRules};
use crate::task::{Category, Task};
use scene::{BodySpec, Range, RegionSpec, RenderParts, ScaledBy, Scene, SceneSpec, WidenedRanges};

pub(crate) const TASK: Task = Task {
    env_id: "PlaceBookInShelf-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 216,
    demo_steps: 182.5,
    instruction: "place the book into the bookshelf",
    lerobot_instruction: "Place the book on the shelf",
    paraphrases: include_str!("paraphrases/place_book_in_shelf.txt"),
    nominal,
    success,
    expert,
};

/// Initial joint positions in rad: the hand level above the table.
const QPOS: [f64; 7] = [-0.816, 0.109, 0.437, -3.005, 2.678, 1.626, -2.312];
/// World z of the book's origin at the start, in m: it drops 13 mm.
const BOOK_Z: f64 = 0.089;
/// Roll, pitch and yaw of the book at the start, in rad. It lands upright and keeps its yaw.
const BOOK_TILT: [f64; 3] = [0.0593, 0.0175, 0.0768];
/// Gap between the book and the bookcase at the start, in m.
const START_GAP: f64 = 0.005;

fn nominal(profile: Profile) -> SceneSpec {
    let [roll, pitch, yaw] = BOOK_TILT;
    let reason = "the benchmark keeps its size";
    let book = BodySpec {
        visuals: book::visuals(),
        mass: book::MASS,
        scaled_by: ScaledBy::Nothing(reason),
        ..movable("book", book::parts(), 0, SINGLE_TABLE_Z)
    };
    let book =
        book.with_orientation(UnitQuaternion::from_euler_angles(roll, pitch, yaw)).with_origin_z(BOOK_Z);
    let shelf = BodySpec {
        visuals: bookcase::visuals(),
        // The benchmark's mesh is not public; its name is that of a scan, which has one material.
        render_parts: RenderParts::Single,
        ..fixed("shelf", bookcase::parts(), 1, SINGLE_TABLE_Z, reason)
    };
    let y = Range::new(-0.4, -0.2);
    let shelf_region = region("shelf", Range::new(0.0, 0.1), y);
    // The bookcase is behind the book's region, so its region moves away when that is widened.
    let widened = shelf_region.widened.map(|widened| WidenedRanges { x: Range::new(0.05, 0.15), ..widened });
    let regions = vec![region("book", Range::new(-0.2, -0.1), y), RegionSpec { widened, ..shelf_region }];
    let eye = |y| [[-0.5, y, 0.5], [-0.3, -0.3, 0.1]];
    let cameras = ExternalCameras { external1: eye(-0.1), external2: eye(-0.5) };
    let scene = single_arm(QPOS, 0.0, &cameras, regions, vec![book, shelf], TASK.instruction);
    // Drawn independently, the two overlap in 59 % of the episodes.
    SceneSpec { min_start_gap_m: profile.separates_starts().then_some(START_GAP), ..scene }
}

/// Requires the book in the bookcase's slot, released and at rest.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("book");
    let slot = Region::Box { min: [-0.083, -0.07, 0.14], max: [0.067, 0.02, 0.165] };
    vec![
        Predicate::Inside { body, point: [0.0; 3], of: Some(scene.body_idx("shelf")), region: slot },
        Predicate::AtRest { body, max_linear: 0.01, max_angular: 0.5 },
        Predicate::Released { body },
    ]
}

/// Depth of the book's spine between the fingers, in m.
const GRASP_DEPTH: f64 = 0.025;
/// Height above the pre-grasp pose at which the hand arrives, in m.
const APPROACH_HEIGHT: f64 = 0.05;
/// Position (x, y) of the book's centre at release in the bookcase's frame, in m: in the middle between the
/// wall and the leaning books, as deep as the hand can reach in front of the bookcase.
const RELEASE: [f64; 2] = [-0.112, -0.052];
/// Distance in front of its final position from which the book is moved into the bookcase, in m.
const STANDOFF: f64 = 0.2;
/// Height above the shelf at which the book is moved in, in m.
const CLEARANCE: f64 = 0.015;

fn expert(scene: &Scene) -> Vec<Move> {
    let book = scene.body("book");
    let (_, _, yaw) = book.pose.rotation.euler_angles();
    let upright = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let start_closing = grasp::start_closing(scene, 0);
    // The pose of the gripper that holds a book of this orientation.
    let holding = |centre: Vector3<f64>, rotation: UnitQuaternion<f64>| {
        let approach = rotation * Vector3::x();
        let closing = grasp::closest_closing(rotation * Vector3::y(), &start_closing);
        grasp::pose(&(centre + approach * (GRASP_DEPTH - book::HALF[0])), &approach, &closing)
    };
    let mut centre = book.point(book::CENTRE).coords;
    centre.z = SINGLE_TABLE_Z + book::HALF[2];
    let at = holding(centre, upright);
    let pre_grasp = grasp::translated(&grasp::retreated(&at, 0.1), &(Vector3::z() * 0.05));
    let [x, y] = RELEASE;
    let shelf = scene.body("shelf").pose.translation.vector;
    let released = shelf + Vector3::new(x, y, bookcase::FLOOR_Z + book::HALF[2] + 0.002);
    let down = holding(released, UnitQuaternion::identity());
    let within = grasp::translated(&down, &(Vector3::z() * CLEARANCE));
    vec![
        Move::Limit { per_joint: 0.75 },
        // Approach from above: a hand coming from the side would knock the book over.
        Move::Joint(vec![TcpGoal {
            arm: 0,
            tcp: grasp::translated(&pre_grasp, &(Vector3::z() * APPROACH_HEIGHT)),
        }]),
        Move::line(0, at),
        Move::close_gently(6),
        Move::straight(0, grasp::retreated(&within, STANDOFF)),
        Move::straight(0, within),
        Move::straight(0, down),
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&down, 0.1)),
    ]
}
