//! The report as people and programs read it.

use std::time::Duration;

use sim::{Perturbation, TaskId};

use super::*;
use crate::fleet::Totals;
use crate::sweep::Sweep;

fn plan() -> Plan {
    let policies = ["idle", "expert"].map(str::to_owned).to_vec();
    Plan::new(&Sweep { policies, ..Sweep::default() }, 1).unwrap()
}

fn cell(policy: &str, sums: CellSums) -> Cell {
    let condition = Condition { task: TaskId::RaiseCube, perturbation: Perturbation::MoColor };
    Cell { policy: policy.to_owned(), condition, sums }
}

fn cells() -> Vec<Cell> {
    vec![
        cell("idle", CellSums::default()),
        cell("expert", CellSums { n: 10, success_once: 10, success_at_end: 9, steps: 741, errors: 1 }),
    ]
}

#[test]
fn the_table_aligns_and_names_the_expert_for_what_it_is() {
    insta::assert_snapshot!(table(&plan(), &cells()), @"");
}

#[test]
fn the_object_has_the_names_others_rely_on() {
    let fps = Fps::new(&Totals::default(), Duration::from_secs(2), 2);
    assert_eq!(fps.lines(), "");
    let object = json(&serde_json::json!({ "seed": 0 }), &cells(), &fps);
    insta::assert_snapshot!(format!("{object:#}"), @"");
}
