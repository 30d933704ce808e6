//! `hypogeum tasks`: the task suite, and which perturbation applies where.

use serde_json::{Value, json};
use sim::scene::{Role, SceneSpec};
use sim::{Perturbation, TaskId};

use crate::cli::TasksArgs;
use crate::failure::{Ending, Failure};
use crate::report::{Align, Table, print_out};

/// Prints the suite.
pub(crate) fn list(args: &TasksArgs) -> Result<Ending, Failure> {
    let text = match (args.json, args.matrix) {
        (true, _) => format!("{:#}\n", suite_json()),
        (false, true) => matrix(),
        (false, false) => table(),
    };
    print_out(&text)?;
    Ok(Ending::Done)
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
    let mut table = Table::new(&columns);
    for id in TaskId::ALL {
        let task = id.task();
        let nominal = (task.nominal)();
        let named = |role| match of_role(&nominal, role).collect::<Vec<_>>() {
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

/// Names of the bodies that have a role.
fn of_role(nominal: &SceneSpec, role: Role) -> impl Iterator<Item = &'static str> {
    nominal.bodies.iter().filter(move |body| body.role == role).map(|body| body.name)
}

/// A column per perturbation that some task is without, where a number stands for the reason below; the others are listed.
fn matrix() -> String {
    let nominals: Vec<SceneSpec> = TaskId::ALL.iter().map(|id| (id.task().nominal)()).collect();
    let (everywhere, somewhere): (Vec<Perturbation>, Vec<Perturbation>) = Perturbation::ALL
        .iter()
        .partition(|perturbation| nominals.iter().all(|nominal| perturbation.applies_to(nominal).is_ok()));
    let mut columns = vec![("task", Align::Left)];
    columns.extend(somewhere.iter().map(|perturbation| (perturbation.name(), Align::Left)));
    let mut table = Table::new(&columns);
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
        let nominal = (task.nominal)();
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
            "manipulation_objects": of_role(&nominal, Role::ManipulationObject).collect::<Vec<_>>(),
            "receiver_objects": of_role(&nominal, Role::ReceiverObject).collect::<Vec<_>>(),
            "perturbations": applies.collect::<Vec<_>>(),
        })
    });
    json!({ "tasks": tasks.collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_has_a_row_and_every_gap_a_reason() {
        let (table, matrix) = (table(), matrix());
        for id in TaskId::ALL {
            assert!(table.lines().any(|line| line.starts_with(id.name())), "{table}");
        }
        let row = table.lines().find(|line| line.starts_with("StackCube")).unwrap();
        let cells: Vec<&str> = row.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect();
        assert_eq!(cells[3..6], ["142", "red cube", "–"], "{row}");
        let row = matrix.lines().find(|line| line.starts_with("RaiseCube")).unwrap();
        assert_eq!(row.split_whitespace().collect::<Vec<_>>()[..3], ["RaiseCube", "yes", "yes"]);
        let json = suite_json();
        for task in json["tasks"].as_array().unwrap() {
            for cell in task["perturbations"].as_array().unwrap() {
                assert_eq!(cell["applies"].as_bool().unwrap(), cell["reason"].is_null());
            }
        }
    }
}
