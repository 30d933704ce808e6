//! PlaceBookInShelf: put an upright book next to others on a shelf. See docs/benchmark.md, "Tasks".

use ipc_types::Morphology;
use nalgebra::{Isometry3, Vector3};

use super::common::props::{self, Bookcase};
use super::common::{ExternalCameras, SINGLE_TABLE_Z, box_part, fixed, movable, region, single_arm};
use crate::expert::{Move, TcpGoal, grasp};
use crate::predicate::{Predicate, Region};
use crate::profile::Profile;
use crate::scene::{
    AppearanceSpec, BodySpec, PlacementSpec, Range, RegionSpec, Role, ScaledBy, Scene, SceneSpec,
    WidenedRanges,
};
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

/// Initial joint positions in rad: the hand level above the table.
const QPOS: [f64; 7] = [-0.816, 0.109, 0.437, -3.005, 2.678, 1.626, -2.312];
/// Half-depth, half-thickness and half-height of the book in m. It stands upright with its spine towards the
/// robot.
const BOOK_HALF: [f64; 3] = [0.0525, 0.014, 0.0705];
/// Centre of the book in its frame, in m. It is that of the benchmark's mesh in its initial orientation, so
/// that the upright book's origin is 0.0885 m above its support, and 0.15 m above the table on a shelf at
/// 0.062 m.
const BOOK_CENTRE: [f64; 3] = [-0.045, -0.017, -0.018];
const BLUE: [f64; 3] = [0.10, 0.20, 0.36];
/// The bookcase. Its front is as near to the robot as the book on the table allows; other books leave its −y
/// half free.
const BOOKCASE: Bookcase<2> =
    Bookcase { half: [0.075, 0.18], height: 0.45, centre: [-0.01, 0.03], shelves_z: [0.062, 0.262] };

fn nominal() -> SceneSpec {
    let book = BodySpec {
        visuals: props::book(BOOK_HALF, BOOK_CENTRE, BLUE),
        scaled_by: ScaledBy::Nothing("the benchmark keeps its size"),
        ..movable(
            "book",
            vec![box_part(BOOK_HALF, BOOK_CENTRE, AppearanceSpec::plain(BLUE))],
            0,
            SINGLE_TABLE_Z,
        )
    };
    let shelf = fixed("shelf", BOOKCASE.parts(), 1, SINGLE_TABLE_Z, "the benchmark keeps its size");
    let rows = [BOOKCASE.row(0, BOOK_HALF[0], 0), BOOKCASE.row(1, BOOK_HALF[0], 3)].concat();
    let others = BodySpec {
        role: Role::Fixture,
        placement: PlacementSpec::RelativeTo { body: 1, pose: Isometry3::identity() },
        ..fixed("other books", rows, 1, SINGLE_TABLE_Z, "they stand on the shelf")
    };
    let y = Range::new(-0.4, -0.2);
    let shelf_region = region("shelf", Range::new(0.0, 0.1), y);
    // The bookcase is behind the book's region, so its region moves away when that is widened.
    let widened = shelf_region.widened.map(|widened| WidenedRanges { x: Range::new(0.05, 0.15), ..widened });
    let regions = vec![region("book", Range::new(-0.2, -0.1), y), RegionSpec { widened, ..shelf_region }];
    let eye = |y| [[-0.5, y, 0.5], [-0.3, -0.3, 0.1]];
    let cameras = ExternalCameras { external1: eye(-0.1), external2: eye(-0.5) };
    single_arm(QPOS, 0.0, &cameras, regions, vec![book, shelf, others], TASK.instruction)
}

/// Requires the book on the lower shelf next to the others, released and at rest.
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
const APPROACH_HEIGHT: f64 = 0.12;
/// Position of the book's origin at release in the bookcase's frame, in m. The spine is 12 mm in front of the
/// shelf's edge.
const RELEASE: [f64; 3] = [0.0, -0.043, BOOKCASE.shelves_z[0] + BOOK_HALF[2] - BOOK_CENTRE[2]];
/// Distance in front of its final position from which the book is moved into the bookcase, in m.
const STANDOFF: f64 = 0.25;
/// Height above the shelf at which the book is moved in, in m.
const CLEARANCE: f64 = 0.015;

fn expert(scene: &Scene) -> Vec<Move> {
    let book = scene.body("book");
    let closing = grasp::closest_closing(Vector3::y(), &grasp::start_closing(scene, 0));
    let centre = book.pose.translation.vector + Vector3::from(BOOK_CENTRE);
    let at = grasp::pose(&(centre + Vector3::x() * (GRASP_DEPTH - BOOK_HALF[0])), &Vector3::x(), &closing);
    let pre_grasp = grasp::translated(&at, &Vector3::new(-0.1, 0.0, 0.05));
    let release = scene.body("shelf").pose.translation.vector + Vector3::from(RELEASE);
    let down = grasp::translated(&at, &(release - book.pose.translation.vector + Vector3::z() * 0.002));
    let within = grasp::translated(&down, &(Vector3::z() * CLEARANCE));
    vec![
        // Approach from above: a hand coming from the side would knock the book over.
        Move::Joint(vec![TcpGoal {
            arm: 0,
            tcp: grasp::translated(&pre_grasp, &(Vector3::z() * APPROACH_HEIGHT)),
        }]),
        Move::straight(0, pre_grasp),
        Move::straight(0, at),
        Move::close(&[0], 6),
        Move::straight(0, grasp::retreated(&within, STANDOFF)),
        Move::straight(0, within),
        Move::straight(0, down),
        Move::open(&[0], 6),
        Move::straight(0, grasp::retreated(&down, 0.1)),
    ]
}
