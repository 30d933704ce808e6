//! Tests of the report's text and JSON.

use std::time::Duration;

use sim::serve::protocol::{Counters, Latencies};
use sim::{Perturbation, TaskId};

use crate::fleet::{EnvChoice, EnvTrial, HostWork, Totals};
use crate::plan::sweep::SweepArgs;
use crate::selection::condition::Condition;
use crate::store::results::CellSums;
use crate::study::machine::Cores;
use crate::study::report::*;

const CORES: Cores = Cores { count: 2, n_threads: 2, peak_gflop: Some(100.0) };

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
    assert_eq!((fps.lines(), fps.line()), (String::new(), String::new()));
    let object = json(&serde_json::json!({ "seed": 0 }), &cells(), &[], &fps);
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
        "attached": [],
        "bound": null,
        "definition": "control steps of finished and unfinished episodes / wall seconds from the first work (building the first world) to the last control step, over all envs, policy inference included",
        "device": null,
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
        device_s: 0.0,
        idle_s: 0.1,
        cpu_s: 1.2,
        foreign_s: Vec::new(),
        latencies,
    });
    // Batches of 5 on 2 threads: both are busy all the time.
    totals.on_host_work(
        0,
        HostWork { queries: 100, batches: 20, busy_s: 2.0, cpu_s: 2.1, device_s: 0.0, flop: 150_000_000_000 },
    );
    let trial = |envs, predicted, foreign| EnvTrial { envs, predicted, utilisation: 0.8, foreign };
    let trials = vec![trial(16, 1400.0, 0.0), trial(32, 1410.0, 0.25)];
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
    insta::assert_snapshot!(fps.line(), @"1500.0 env-steps/s: 3000 control steps in 2.00 s; 75 % of the bound by cores and devices (--verbose: where the time went)");
    insta::assert_snapshot!(fps.lines(), @r"
    env_steps_per_s  1500.0 (3000 control steps in 2.00 s, from the first work to the last step)
    whole process    750.0 env-steps/s (4.00 s, start-up included)
    per second       150.0 images, 50.0 queries
    core-seconds     physics 0.60, render 0.40, policy 2.00, transport 0.30, unused 0.70; sim idle for 0.10 s
    bound            2000.0 env-steps/s = c / (s + (r + w) / k) with c = 2 cores, s = 0.200 ms, r = 4.000 ms, w = 20.000 ms, k = 30.0; 75 % reached
    inference        75.0 GFLOP/s per core, 75 % of the 100.0 that a core reaches in f32 on registers only
    envs             16, chosen from at most 256; expected env-steps/s: 16 (1400, cores 80 % used), 32 (1410, cores 80 % used, 25 % taken by other programs)
    ");
}

#[test]
fn bound_of_device_is_its_own() {
    let counters = |env_steps, queries, latencies| Counters {
        env_steps,
        queries,
        wall_s: 2.0,
        physics_s: 0.6,
        render_s: 0.1,
        device_s: 0.5,
        cpu_s: 1.2,
        latencies,
        ..Counters::default()
    };
    let mut totals = Totals::new(2, None);
    let mut latencies = Latencies::default();
    latencies.record(Duration::from_millis(5), 100);
    totals.on_sim_counters(counters(3000, 100, latencies));
    let work =
        HostWork { queries: 50, batches: 10, busy_s: 0.1, cpu_s: 0.2, device_s: 1.6, flop: 400_000_000_000 };
    totals.on_host_work(0, work);
    totals.on_host_work(1, HostWork { device_s: 0.9, ..work });
    let fps = Fps::new(&totals, Duration::from_secs(4), CORES);
    // The busiest lane counts: 3000 steps in 1.6 s of the device, 6,667 by the cores.
    let bound = fps.bound.unwrap();
    assert!((bound.env_steps_per_s - 3000.0 / 1.6).abs() < 1e-9, "{bound:?}");
    assert_eq!((bound.device_s, fps.inference), (Some(0.016), None));
    insta::assert_snapshot!(fps.lines(), @r"
    env_steps_per_s  1500.0 (3000 control steps in 2.00 s, from the first work to the last step)
    whole process    750.0 env-steps/s (4.00 s, start-up included)
    per second       0.0 images, 50.0 queries
    core-seconds     physics 0.60, render 0.10, policy 0.20, transport 0.70, unused 2.40; sim idle for 0.00 s
    bound            1875.0 env-steps/s = min(c / (s + (r + w) / k), k / d) with c = 2 cores, s = 0.200 ms, r = 1.000 ms, w = 2.000 ms, d = 16.000 ms, k = 30.0; 80 % reached
    device           rendering 0.50 s (25 %), policies 1.60 s (80 %), at 500.0 GFLOP/s
    ");
    // A device that waits for the cores does not bound them.
    let fast = |lane| HostWork { device_s: 0.1 * f64::from(lane), ..work };
    totals.on_host_work(0, fast(0));
    totals.on_host_work(1, fast(1));
    totals.on_sim_counters(Counters { device_s: 0.0, ..totals.sim() });
    let bound = Fps::new(&totals, Duration::from_secs(4), CORES).bound.unwrap();
    assert!((bound.env_steps_per_s - 2.0 * 3000.0 / (0.6 + 0.1 + 0.2)).abs() < 1e-9, "{bound:?}");
}

/// Two cores are of no use to a sim with one thread and a host that hardly works.
#[test]
fn bound_of_few_threads_is_their_own() {
    let mut totals = Totals::new(1, None);
    let mut latencies = Latencies::default();
    latencies.record(Duration::from_millis(5), 100);
    totals.on_sim_counters(Counters {
        env_steps: 3000,
        queries: 100,
        wall_s: 2.0,
        physics_s: 1.2,
        render_s: 0.6,
        cpu_s: 1.9,
        latencies,
        ..Counters::default()
    });
    let work = HostWork { queries: 100, batches: 20, busy_s: 0.1, cpu_s: 0.1, device_s: 0.0, flop: 0 };
    totals.on_host_work(0, work);
    let one_thread = Cores { n_threads: 1, ..CORES };
    let bound = |totals: &Totals| Fps::new(totals, Duration::from_secs(4), one_thread).bound.unwrap();
    assert!((bound(&totals).env_steps_per_s - 3000.0 / 1.8).abs() < 1e-9, "{:?}", bound(&totals));
    let lines = Fps::new(&totals, Duration::from_secs(4), one_thread).lines();
    let line = lines.lines().find(|line| line.starts_with("bound"));
    insta::assert_snapshot!(line.unwrap(), @"bound            1666.7 env-steps/s = min(c / (s + (r + w) / k), t / p) with c = 2 cores, t = 1 per process, p = 0.600 ms, s = 0.400 ms, r = 6.000 ms, w = 1.000 ms, k = 30.0; 90 % reached");
    // A host may be the busier one, and both together may occupy all cores.
    totals.on_host_work(0, HostWork { busy_s: 2.4, ..work });
    assert!((bound(&totals).env_steps_per_s - 3000.0 / 2.4).abs() < 1e-9, "{:?}", bound(&totals));
    totals.on_host_work(0, HostWork { busy_s: 1.8, ..work });
    assert!((bound(&totals).env_steps_per_s - 3000.0 / 1.8).abs() < 1e-9, "{:?}", bound(&totals));
}

#[test]
fn bound_of_attached_host_is_its_own() {
    let mut totals = Totals::new(3, None);
    totals.foreign = vec![Some("mine".to_owned()), None, Some("other".to_owned())];
    totals.on_sim_counters(Counters {
        env_steps: 3000,
        queries: 100,
        wall_s: 2.0,
        physics_s: 0.6,
        cpu_s: 0.6,
        foreign_s: vec![1.8, 0.0, 0.4],
        ..Counters::default()
    });
    let fps = Fps::new(&totals, Duration::from_secs(4), CORES);
    let bound = fps.bound.unwrap();
    assert!((bound.env_steps_per_s - 3000.0 / 1.8).abs() < 1e-9, "{bound:?}");
    assert!((bound.reached - 0.9).abs() < 1e-9, "{bound:?}");
    let lines = fps.lines();
    let line = lines.lines().find(|line| line.starts_with("attached"));
    assert_eq!(line, Some("attached hosts   mine 1.80 s (90 %), other 0.40 s (20 %) with queries"));
}
