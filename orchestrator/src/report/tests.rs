//! Tests of the report's text and JSON.

use std::time::Duration;

use sim::serve::protocol::{Counters, Latencies};
use sim::{Perturbation, TaskId};

use super::*;
use crate::fleet::{EnvChoice, EnvTrial, HostWork, Totals};
use crate::machine::Cores;
use crate::sweep::SweepArgs;

const CORES: Cores = Cores { count: 2, peak_gflop: Some(100.0) };

fn plan() -> RunPlan {
    RunPlan::new(&SweepArgs::parse("--policy idle --policy expert").unwrap()).unwrap()
}

fn cell(policy: &str, sums: CellSums) -> Cell {
    let condition = Condition { task: TaskId::RaiseCube, perturbation: Perturbation::MoColor.into() };
    Cell { policy: policy.to_owned(), condition, sums }
}

fn cells() -> Vec<Cell> {
    vec![
        cell("idle", CellSums::default()),
        cell("expert", CellSums { n: 10, success_once: 10, success_at_end: 9, steps: 741, errors: 1 }),
    ]
}

#[test]
fn table_aligns_and_explains_the_expert() {
    insta::assert_snapshot!(table(&plan(), &cells(), &[]), @r"
    policy  task       perturbation   n  success_once   95 % interval  success_at_end  mean_steps  errors
    idle    RaiseCube  MO-Color       0             –               –               –           –       0
    expert  RaiseCube  MO-Color      10       100.0 %  72.2 – 100.0 %          90.0 %        74.1       1
    expert: the scripted expert, which reads privileged state; a ceiling, not a policy
    ");
}

#[test]
fn json_keys_are_stable() {
    let fps = Fps::new(&Totals::default(), Duration::from_secs(2), CORES);
    assert_eq!(fps.lines(), "");
    let object = json(&serde_json::json!({ "seed": 0 }), &cells(), &fps);
    insta::assert_snapshot!(format!("{object:#}"), @r#"
    {
      "cells": [
        {
          "errors": 0,
          "mean_steps": null,
          "n": 0,
          "perturbation": "MO-Color",
          "policy": "idle",
          "success_at_end": null,
          "success_once": null,
          "task": "RaiseCube",
          "wilson95": null
        },
        {
          "errors": 1,
          "mean_steps": 74.1,
          "n": 10,
          "perturbation": "MO-Color",
          "policy": "expert",
          "success_at_end": 0.9,
          "success_once": 1.0,
          "task": "RaiseCube",
          "wilson95": [
            0.7224672001371107,
            0.9999999999999999
          ]
        }
      ],
      "changes": [],
      "fps": {
        "bound": null,
        "definition": "control steps of finished and unfinished episodes / wall seconds from the first work (building the first world) to the last control step, over all envs, policy inference included",
        "env_steps": 0,
        "env_steps_per_s": null,
        "images_per_s": null,
        "inference": null,
        "process_env_steps_per_s": 0.0,
        "process_wall_s": 2.0,
        "queries_per_s": null,
        "wall_s": 0.0
      },
      "ledger": {
        "physics_s": 0.0,
        "policy_s": 0.0,
        "render_s": 0.0,
        "transport_s": 0.0,
        "unused_s": 0.0,
        "wait_s": 0.0
      },
      "run": {
        "seed": 0
      }
    }
    "#);
}

#[test]
fn speed_and_bound_follow_their_definitions() {
    let mut totals = Totals::new(1, None);
    let mut latencies = Latencies::default();
    latencies.record(Duration::from_millis(5), 100);
    totals.on_sim_counters(Counters {
        env_steps: 3000,
        images: 300,
        queries: 100,
        wall_s: 2.0,
        physics_s: 0.6,
        render_s: 0.4,
        idle_s: 0.1,
        cpu_s: 1.2,
        latencies,
    });
    // Batches of 5 on 2 threads: both are busy all the time.
    totals.on_host_work(
        0,
        HostWork { queries: 100, batches: 20, busy_s: 2.0, cpu_s: 2.1, flop: 150_000_000_000 },
    );
    let trial = |envs, predicted, utilisation| EnvTrial { envs, predicted, utilisation };
    let trials = vec![trial(16, 1400.0, 0.8), trial(32, 1410.0, 0.81)];
    totals.choice = Some(EnvChoice { envs: 16, max_envs: 256, trials });
    let fps = Fps::new(&totals, Duration::from_secs(4), CORES);
    assert_eq!((fps.env_steps_per_s, fps.process_env_steps_per_s), (Some(1500.0), 750.0));
    assert_eq!((fps.images_per_s, fps.queries_per_s), (Some(150.0), Some(50.0)));
    let bound = fps.bound.unwrap();
    let (s, r, w, k) = (0.6 / 3000.0, 0.4 / 100.0, 2.0 / 100.0, 30.0);
    assert_eq!((bound.step_s, bound.render_s, bound.query_s), (s, r, w));
    assert_eq!(bound.steps_per_query, Some(k));
    assert!((bound.env_steps_per_s - 2.0 / (s + (r + w) / k)).abs() < 1e-9);
    assert!((bound.reached - 1500.0 / 2000.0).abs() < 1e-12);
    insta::assert_snapshot!(fps.lines(), @r"
    env_steps_per_s  1500.0 (3000 control steps in 2.00 s, from the first work to the last step)
    whole process    750.0 env-steps/s (4.00 s, start-up included)
    per second       150.0 images, 50.0 queries
    core-seconds     physics 0.60, render 0.40, policy 2.00, transport 0.30, unused 0.70; sim idle for 0.10 s
    bound            2000.0 env-steps/s = c / (s + (r + w) / k) with c = 2 cores, s = 0.200 ms, r = 4.000 ms, w = 20.000 ms, k = 30.0; 75 % reached
    inference        75.0 GFLOP/s per core, 75 % of the 100.0 that a core reaches in f32 on registers only
    envs             16, chosen from at most 256; expected env-steps/s: 16 (1400, cores 80 % used), 32 (1410, cores 81 % used)
    ");
}
