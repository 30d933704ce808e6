//! Points as a table, as JSON, as CSV files with the original's columns, and as a figure.

use serde_json::json;

use crate::console::output_files::OutputFolder;
use crate::console::table::{Align, TextTable};
use crate::study::page::{FpsSeries, fps_svgs};
use crate::study::speed::plan::Omission;
use crate::study::speed::point::{PAPER_STEPS, Series, SpeedPoint};
use crate::study::speed::store::SpeedSettings;

/// Tasks and episodes per task from which the original extrapolates the time of a whole evaluation.
const EXTRAPOLATED_EPISODES: f64 = 17.0 * 20.0;

/// Returns the table that people read.
pub(crate) fn table(points: &[SpeedPoint]) -> String {
    let columns = [
        "policy",
        "mode",
        "envs",
        "env-steps/s",
        "paper FPS",
        "images/s",
        "queries/s",
        "p50 ms",
        "p95 ms",
        "physics",
        "render",
        "policy",
        "transport",
        "unused",
        "MiB",
        "shm MiB",
        "bound",
        "reached",
        "peak",
        "device",
    ];
    let columns: Vec<_> = columns
        .iter()
        .enumerate()
        .map(|(idx, name)| (*name, if idx < 2 { Align::Left } else { Align::Right }))
        .collect();
    let mut table = TextTable::new(&columns);
    for point in points {
        let micro = |seconds: f64| format!("{:.0}", 1e6 * seconds);
        let milli = |seconds: Option<f64>| seconds.map_or("–".to_owned(), |s| format!("{:.1}", 1e3 * s));
        let percent =
            |fraction: Option<f64>| fraction.map_or("–".to_owned(), |f| format!("{:.0} %", 100.0 * f));
        let parts = point.core_s_per_step;
        table.row(vec![
            point.series.policy.clone(),
            point.series.mode_name().to_owned(),
            point.envs.to_string(),
            format!("{:.1}", point.env_steps_per_s),
            format!("{:.1}", point.paper_fps),
            format!("{:.0}", point.images_per_s),
            format!("{:.1}", point.queries_per_s),
            milli(point.latency_p50_s),
            milli(point.latency_p95_s),
            micro(parts.physics),
            micro(parts.render),
            micro(parts.policy),
            micro(parts.transport),
            micro(parts.unused),
            (point.memory_bytes >> 20).to_string(),
            (point.shm_bytes >> 20).to_string(),
            format!("{:.0}", point.bound_env_steps_per_s),
            format!("{:.0} %", 100.0 * point.reached),
            percent(point.peak_fraction),
            percent(point.device_fraction),
        ]);
    }
    format!("{table}physics to unused: core-microseconds per control step\n")
}

/// Writes `fps.json`, `fps.svg`, and one CSV file with the original's columns per series.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn write_files(
    folder: &mut OutputFolder,
    settings: &SpeedSettings,
    points: &[SpeedPoint],
    omissions: &[Omission],
) -> anyhow::Result<()> {
    let omitted: Vec<_> = omissions
        .iter()
        .map(|it| json!({ "series": it.series, "envs": it.envs, "reason": it.reason }))
        .collect();
    let all = json!({ "settings": settings, "points": points, "omitted": omitted });
    folder.write("fps.json", format!("{all:#}\n").as_bytes())?;
    let mut series: Vec<&Series> = Vec::new();
    for point in points {
        if !series.contains(&&point.series) {
            series.push(&point.series);
        }
    }
    let of = |series: &Series| -> Vec<&SpeedPoint> {
        let mut own: Vec<_> = points.iter().filter(|point| point.series == *series).collect();
        own.sort_by_key(|point| point.envs);
        own
    };
    for series in &series {
        folder.write(&format!("{}.csv", series.name()), csv(&of(series)).as_bytes())?;
    }
    let curves = series.iter().map(|series| FpsSeries {
        name: series.name(),
        points: of(series).iter().map(|point| (f64::from(point.envs), point.env_steps_per_s)).collect(),
    });
    let [svg, _] = fps_svgs(&curves.collect::<Vec<_>>());
    folder.write("fps.svg", svg.as_bytes())?;
    Ok(())
}

/// Returns the columns that the original's script writes.
fn csv(points: &[&SpeedPoint]) -> String {
    let mut text = "batch_size,t_elapsed_sec,frames_per_second,seconds_per_frame,timesteps_per_task,\
        rlbench_estimated_total_sim_time_seconds,rlbench_estimated_total_sim_time_minutes,\
        rlbench_estimated_total_sim_time_hours\n"
        .to_owned();
    for point in points {
        let elapsed = point.paper_elapsed_s();
        let total = EXTRAPOLATED_EPISODES * elapsed / f64::from(point.envs);
        text += &format!(
            "{},{elapsed},{},{},{PAPER_STEPS},{total},{},{}\n",
            point.envs,
            point.paper_fps,
            1.0 / point.paper_fps,
            total / 60.0,
            total / 3600.0
        );
    }
    text
}
