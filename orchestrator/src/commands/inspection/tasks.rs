//! `hypogeum tasks`: the task suite, and the perturbations that apply to each task.

use clap::Args;
use serde_json::{Value, json};
use sim::scene::{Role, SceneSpec};
use sim::{Perturbation, Profile, TaskId};

use crate::console::exit::{ExitStatus, Failure};
use crate::console::output::print_out;
use crate::console::table::{Align, TextTable};

/// Arguments of `tasks`.
#[derive(Debug, Args)]
pub(crate) struct TasksArgs {
    /// Show which perturbations apply to which task, and the reasons for those that do not
    #[arg(long)]
    pub(crate) matrix: bool,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
}

/// Prints the suite.
pub(crate) fn tasks(args: &TasksArgs) -> Result<ExitStatus, Failure> {
    let text = match (args.json, args.matrix) {
        (true, _) => format!("{:#}\n", suite_json()),
        (false, true) => matrix(),
        (false, false) => table(),
    };
    print_out(&text)?;
    Ok(ExitStatus::Success)
}

fn table() -> String {
    use Align::{Left, Right};
    let columns = [
        ("task", Left),
        ("robot", Left),
        ("category", Left),
        ("max_steps", Right),
        ("MO", Left),
        ("RO", Left),
        ("instruction", Left),
    ];
    let mut table = TextTable::new(&columns);
    for id in TaskId::ALL {
        let task = id.task();
        let nominal = (task.nominal)(Profile::Strict);
        let named = |role| match bodies_with_role(&nominal, role).collect::<Vec<_>>() {
            names if names.is_empty() => "–".to_owned(),
            names => names.join(", "),
        };
        table.row(vec![
            id.name().to_owned(),
            task.morphology.name().to_owned(),
            task.category.name().to_owned(),
            task.max_steps.to_string(),
            named(Role::ManipulationObject),
            named(Role::ReceiverObject),
            task.instruction.to_owned(),
        ]);
    }
    table.to_string()
}

/// Returns the names of the bodies that have a role.
fn bodies_with_role(nominal: &SceneSpec, role: Role) -> impl Iterator<Item = &'static str> {
    nominal.bodies.iter().filter(move |body| body.role == role).map(|body| body.name)
}

/// Formats a table with one column per perturbation that does not apply to every task. Numbers refer to the
/// reasons listed below it. The perturbations that apply everywhere are listed last.
fn matrix() -> String {
    let nominals: Vec<SceneSpec> =
        TaskId::ALL.iter().map(|id| (id.task().nominal)(Profile::Strict)).collect();
    let (everywhere, somewhere): (Vec<Perturbation>, Vec<Perturbation>) = Perturbation::ALL
        .iter()
        .partition(|perturbation| nominals.iter().all(|nominal| perturbation.applies_to(nominal).is_ok()));
    let mut columns = vec![("task", Align::Left)];
    columns.extend(somewhere.iter().map(|perturbation| (perturbation.name(), Align::Left)));
    let mut table = TextTable::new(&columns);
    let mut reasons: Vec<String> = Vec::new();
    for (id, nominal) in TaskId::ALL.iter().zip(&nominals) {
        let mut row = vec![id.name().to_owned()];
        for perturbation in &somewhere {
            row.push(match perturbation.applies_to(nominal) {
                Ok(()) => "yes".to_owned(),
                Err(error) => {
                    let known = reasons.iter().position(|reason| *reason == error.reason);
                    let idx = known.unwrap_or(reasons.len());
                    if known.is_none() {
                        reasons.push(error.reason);
                    }
                    format!("– [{}]", idx + 1)
                }
            });
        }
        table.row(row);
    }
    let mut text = table.to_string();
    for (idx, reason) in reasons.iter().enumerate() {
        text += &format!("\n[{}] {reason}", idx + 1);
    }
    let names: Vec<&str> = everywhere.iter().map(|perturbation| perturbation.name()).collect();
    text + &format!("\n\nEvery task: {}.\n", names.join(", "))
}

fn suite_json() -> Value {
    let tasks = TaskId::ALL.iter().map(|id| {
        let task = id.task();
        let nominal = (task.nominal)(Profile::Strict);
        let applies = Perturbation::ALL.iter().map(|perturbation| {
            let reason = perturbation.applies_to(&nominal).err().map(|error| error.reason);
            json!({ "perturbation": perturbation.name(), "applies": reason.is_none(), "reason": reason })
        });
        json!({
            "task": id.name(),
            "env_id": task.env_id,
            "category": task.category.name(),
            "morphology": task.morphology.name(),
            "max_steps": task.max_steps,
            "demo_steps": task.demo_steps,
            "instruction": task.instruction,
            "manipulation_objects": bodies_with_role(&nominal, Role::ManipulationObject).collect::<Vec<_>>(),
            "receiver_objects": bodies_with_role(&nominal, Role::ReceiverObject).collect::<Vec<_>>(),
            "perturbations": applies.collect::<Vec<_>>(),
        })
    });
    json!({ "tasks": tasks.collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn applicability_matrix_is_unchanged() {
        insta::assert_snapshot!(matrix(), @r"
        task                   MO-Color  RO-Color  MO-Texture  RO-Texture  MO-Size  RO-Size  Pose-Randomization
        RaiseCube              yes       – [1]     yes         – [1]       yes      – [1]    yes
        PickSodaFromCabinet    yes       yes       yes         yes         – [2]    – [3]    – [4]
        PickDishFromRack       yes       yes       yes         yes         – [5]    – [6]    – [4]
        StackCube              yes       – [1]     yes         – [1]       yes      – [1]    yes
        PlaceBookInShelf       yes       yes       yes         yes         – [7]    – [8]    yes
        PlaceDishInRack        yes       yes       yes         yes         – [5]    – [6]    yes
        LiftPegUpright         yes       – [1]     yes         – [1]       yes      – [1]    yes
        RotateArrow            yes       – [1]     yes         – [1]       yes      – [1]    yes
        PegInsertionSide       yes       yes       yes         yes         – [9]    – [10]   yes
        PlugCharger            yes       yes       yes         yes         – [11]   – [12]   yes
        HammerNail             yes       yes       yes         yes         yes      – [13]   yes
        ScoopBanana            yes       yes       yes         yes         yes      – [14]   yes
        OpenDrawer             – [15]    – [1]     – [15]      – [1]       – [15]   – [1]    yes
        OpenCabinet            – [15]    – [1]     – [15]      – [1]       – [15]   – [1]    yes
        PlaceCubeInDrawer      – [15]    – [1]     – [15]      – [1]       – [15]   – [1]    yes
        CookItemInPan          yes       yes       yes         yes         yes      yes      yes
        DualArmCubeHandover    yes       – [1]     yes         – [1]       yes      – [1]    yes
        DualArmBottleHandover  yes       – [1]     yes         – [1]       yes      – [1]    yes
        DualArmLiftPot         yes       – [1]     yes         – [1]       yes      – [1]    yes
        DualArmLiftTray        yes       – [1]     yes         – [1]       yes      – [1]    yes
        DualArmPushBox         yes       yes       yes         yes         yes      – [16]   yes
        DualArmPourPot         yes       yes       yes         yes         yes      – [14]   yes
        DualArmThreading       yes       yes       yes         yes         – [17]   – [18]   yes
        DualArmPenCap          yes       yes       yes         yes         – [19]   – [20]   yes
        DualArmDrawerPlace     yes       – [1]     yes         – [1]       – [21]   – [1]    yes
        DualArmDrawerOpen      – [15]    – [1]     – [15]      – [1]       – [15]   – [1]    yes
        DualArmStackCube       yes       yes       yes         yes         yes      – [16]   yes
        DualArmStackTwoCubes   yes       yes       yes         yes         yes      – [16]   yes

        [1] the task has no receiver object
        [2] the size of can is pinned: the benchmark keeps its size
        [3] the size of panels is pinned: the benchmark keeps its size
        [4] the benchmark does not widen its placement regions
        [5] the size of plate is pinned: the slots of the rack are made for it
        [6] the size of rack is pinned: the released code keeps its size
        [7] the size of book is pinned: the benchmark keeps its size
        [8] the size of shelf is pinned: the benchmark keeps its size
        [9] the size of peg is pinned: its size is sampled for every episode
        [10] the size of box is pinned: it fits the peg
        [11] the size of charger is pinned: it would not fit the slots
        [12] the size of receptacle is pinned: the charger would not fit it
        [13] the size of block is pinned: its hole fits the nail
        [14] the receiver objects of the task are scaled by another perturbation
        [15] the task has no manipulation object
        [16] the size of goal is pinned: it is a mark on the table
        [17] the size of needle is pinned: the body that it fits keeps its size
        [18] the size of tripod is pinned: the body that it fits keeps its size
        [19] the size of pen is pinned: the body that it fits keeps its size
        [20] the size of cap is pinned: the body that it fits keeps its size
        [21] the size of cube is pinned: the released code leaves it as it is

        Every task: None, Table-Color, Table-Texture, Light-Color, Distractor-Objects, Background-Color, Background-Texture, Camera-Pose, Language-Paraphrase, Language-None, Language-Random, Language-Other-Task, All.
        ");
    }

    #[test]
    fn tasks_have_rows_and_gaps_have_reasons() {
        let table = table();
        for id in TaskId::ALL {
            assert!(table.lines().any(|line| line.starts_with(id.name())), "{table}");
        }
        let row = table.lines().find(|line| line.starts_with("StackCube")).unwrap();
        let cells: Vec<&str> = row.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect();
        assert_eq!(cells[3..6], ["142", "red cube", "–"], "{row}");
        let json = suite_json();
        for task in json["tasks"].as_array().unwrap() {
            for cell in task["perturbations"].as_array().unwrap() {
                assert_eq!(cell["applies"].as_bool().unwrap(), cell["reason"].is_null());
            }
        }
    }
}
