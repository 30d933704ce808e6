//! The task suite. Adding a task takes one file in this directory and one line in the list below.

pub mod common;

use serde::{Deserialize, Serialize};

use crate::task::Task;

macro_rules! task_list {
    ($($file:ident => $name:ident,)+) => {
        $(mod $file;)+

        /// A task of the suite, by its name in the paper.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "each name's file describes it")]
        pub enum TaskId { $($name,)+ }

        impl TaskId {
            /// All tasks in the benchmark's order.
            pub const ALL: &[Self] = &[$(Self::$name,)+];

            /// Returns the name used in the paper, on the command line and in results.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name),)+ }
            }

            /// Returns the definition of the task.
            #[must_use]
            pub const fn task(self) -> &'static Task {
                match self { $(Self::$name => &$file::TASK,)+ }
            }
        }
    };
}

task_list! {
    raise_cube => RaiseCube,
    pick_soda_from_cabinet => PickSodaFromCabinet,
    pick_dish_from_rack => PickDishFromRack,
    stack_cube => StackCube,
    place_book_in_shelf => PlaceBookInShelf,
    place_dish_in_rack => PlaceDishInRack,
    lift_peg_upright => LiftPegUpright,
    rotate_arrow => RotateArrow,
    peg_insertion_side => PegInsertionSide,
    plug_charger => PlugCharger,
    hammer_nail => HammerNail,
    scoop_banana => ScoopBanana,
    open_drawer => OpenDrawer,
    open_cabinet => OpenCabinet,
    place_cube_in_drawer => PlaceCubeInDrawer,
    cook_item_in_pan => CookItemInPan,
    dual_arm_cube_handover => DualArmCubeHandover,
    dual_arm_bottle_handover => DualArmBottleHandover,
    dual_arm_lift_pot => DualArmLiftPot,
    dual_arm_lift_tray => DualArmLiftTray,
    dual_arm_push_box => DualArmPushBox,
    dual_arm_pour_pot => DualArmPourPot,
    dual_arm_threading => DualArmThreading,
    dual_arm_pen_cap => DualArmPenCap,
    dual_arm_drawer_place => DualArmDrawerPlace,
    dual_arm_drawer_open => DualArmDrawerOpen,
    dual_arm_stack_cube => DualArmStackCube,
    dual_arm_stack_two_cubes => DualArmStackTwoCubes,
}
