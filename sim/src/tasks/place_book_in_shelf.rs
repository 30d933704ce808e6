//! PlaceBookInShelf: put a standing book beside others on a shelf (spec/tasks.md §2, task 5).

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::props::{self, Bookcase};
use super::common::{ExternalCameras, SINGLE_TABLE_Z, box_part, fixed, movable, region, single_arm};
use crate::expert::{Move, TcpGoal, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::scene::{BodySpec, AppearanceSpec, PlacementSpec, Range, RegionSpec, Role, ScaledBy, Scene, SceneSpec, WidenedRanges};
use crate::task::{Category, Task};

pub(super) const TASK: Task = Task {
    env_id: "PlaceBookInShelf-v1",
    category: Category::PickAndPlace,
    morphology: Morphology::Single,
    max_steps: 216,
    demo_steps: 182.5,
    instruction: "place the book into the bookshelf",
    paraphrases: include_str!("paraphrases/place_book_in_shelf.txt"),
    nominal,
    success,
    expert,
};

/// Over the table, the hand level.
const QPOS: [f64; 7] = [-0.816, 0.109, 0.437, -3.005, 2.678, 1.626, -2.312];
/// Half of the book's depth, thickness and height, in m. It stands, its spine towards the robot.
const BOOK_HALF: [f64; 3] = [0.0525, 0.014, 0.0705];
/// The book's middle in its frame, in m: that of the benchmark's mesh as it is turned at the start, so that the origin of
/// the standing book is 0.0885 m above what it stands on and 0.15 m above the table on a board whose top is at 0.062.
const BOOK_MIDDLE: [f64; 3] = [-0.045, -0.017, -0.018];
const BLUE: [f64; 3] = [0.10, 0.20, 0.36];
/// Its front is as near to the robot as the book on the table allows; other books leave its −y half free.
const CASE: Bookcase<2> =
    Bookcase { half: [0.075, 0.18], height: 0.45, middle: [-0.01, 0.03], boards_z: [0.062, 0.262] };

fn nominal() -> SceneSpec {
    let book = BodySpec {
        visuals: props::book(BOOK_HALF, BOOK_MIDDLE, BLUE),
        scaled_by: ScaledBy::Nothing("the benchmark keeps its size"),
        ..movable("book", vec![box_part(BOOK_HALF, BOOK_MIDDLE, AppearanceSpec::plain(BLUE))], 0, SINGLE_TABLE_Z)
    };
    let shelf = fixed("shelf", CASE.parts(), 1, SINGLE_TABLE_Z, "the benchmark keeps its size");
    let rows = [CASE.row(0, BOOK_HALF[0], 0), CASE.row(1, BOOK_HALF[0], 3)].concat();
    let others = BodySpec {
        role: Role::Fixture,
        placement: PlacementSpec::RelativeTo { body: 1, pose: Isometry3::identity() },
        ..fixed("other books", rows, 1, SINGLE_TABLE_Z, "they stand on the shelf")
    };
    let y = Range::new(-0.4, -0.2);
    let shelf_place = region("shelf", Range::new(0.0, 0.1), y);
    // The shelf stands beyond the book's place, so that it moves away as that grows.
    let widened = shelf_place.widened.map(|widened| WidenedRanges { x: Range::new(0.05, 0.15), ..widened });
    let regions =
        vec![region("book", Range::new(-0.2, -0.1), y), RegionSpec { widened, ..shelf_place }];
    let eye = |y| [[-0.5, y, 0.5], [-0.3, -0.3, 0.1]];
    let cameras = ExternalCameras { external1: eye(-0.1), external2: eye(-0.5) };
    single_arm(QPOS, 0.0, &cameras, regions, vec![book, shelf, others], TASK.instruction)
}

/// The book on the lower board beside the others, let go and at rest.
fn success(scene: &Scene, _profile: Profile) -> Vec<Predicate> {
    let body = scene.body_idx("book");
    let slot = Region::Box { min: [-0.083, -0.07, 0.14], max: [0.067, 0.02, 0.165] };
    vec![
        Predicate::Inside { body, point: [0.0; 3], of: Some(scene.body_idx("shelf")), region: slot },
        Predicate::AtRest { body, max_linear: 0.01, max_angular: 0.5 },
        Predicate::Released { body },
    ]
}

/// How deep the spine lies between the fingers, in m.
const GRIP_DEPTH: f64 = 0.025;
/// How far above its way to the book the hand comes, in m.
const OVER: f64 = 0.12;
/// Where the book's origin is let go, in the frame of the shelf, in m: the spine is 12 mm before the board's edge.
const PLACE: [f64; 3] = [0.0, -0.043, CASE.boards_z[0] + BOOK_HALF[2] - BOOK_MIDDLE[2]];
/// How far before its place, and how high over the board, the book is brought to the shelf, in m.
const BEFORE: f64 = 0.25;
const CLEARANCE: f64 = 0.015;

fn expert(scene: &Scene) -> Vec<Move> {
    let book = scene.body("book");
    let closing = grasp::closest_closing(Vector3::y(), &grasp::start_closing(scene, 0));
    let middle = book.pose.translation.vector + Vector3::from(BOOK_MIDDLE);
    let at = grasp::pose(&(middle + Vector3::x() * (GRIP_DEPTH - BOOK_HALF[0])), &Vector3::x(), &closing);
    let before = grasp::translated(&at, &Vector3::new(-0.1, 0.0, 0.05));
    let place = scene.body("shelf").pose.translation.vector + Vector3::from(PLACE);
    let down = grasp::translated(&at, &(place - book.pose.translation.vector + Vector3::z() * 0.002));
    let within = grasp::translated(&down, &(Vector3::z() * CLEARANCE));
    vec![
        // Over the book's top, which the hand would else knock over from the side.
        Move::Joint(vec![TcpGoal { arm: 0, tcp: grasp::translated(&before, &(Vector3::z() * OVER)) }]),
        Move::straight(0, before),
        Move::straight(0, at),
        Move::close(&[0], 6),
        Move::straight(0, grasp::retreated(&within, BEFORE)),
        Move::straight(0, within),
        Move::straight(0, down),
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&down, 0.1)),
    ]
}
