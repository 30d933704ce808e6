//! Points as a table, as JSON, as CSV files with the original's columns, and as a figure.

use run_config::Amount;
use serde_json::json;

use crate::console::output_files::OutputFolder;
use crate::console::table::{Align, TextTable};
use crate::study::page::{Curve, fps_svgs};
use crate::study::speed::plan::Omission;
use crate::study::speed::point::{PAPER_STEPS, SpeedPoint};
use crate::study::speed::store::SpeedSettings;

/// Tasks and episodes per task from which the original extrapolates the time of a whole evaluation.
const EXTRAPOLATED_EPISODES: f64 = 17.0 * 20.0;

/// A column of the table: its name, and its text for a point.
type TableColumn = (&'static str, fn(&SpeedPoint) -> String);

const COLUMNS: [TableColumn; 20] = [
    ("policy", |point| point.series.policy.clone()),
    ("mode", |point| point.series.mode_name().to_owned()),
    ("envs", SpeedPoint::envs_text),
    ("env-steps/s", |point| format!("{:.1}", point.env_steps_per_s)),
    ("paper FPS", |point| format!("{:.1}", point.paper_fps)),
    ("images/s", |point| format!("{:.0}", point.images_per_s)),
    ("queries/s", |point| format!("{:.1}", point.queries_per_s)),
    ("p50 ms", |point| milli(point.latency_p50_s)),
    ("p95 ms", |point| milli(point.latency_p95_s)),
    ("physics", |point| micro(point.core_s_per_step.physics)),
    ("render", |point| micro(point.core_s_per_step.render)),
    ("policy", |point| micro(point.core_s_per_step.policy)),
    ("transport", |point| micro(point.core_s_per_step.transport)),
    ("unused", |point| micro(point.core_s_per_step.unused)),
    ("MiB", |point| (point.memory_bytes >> 20).to_string()),
    ("shm MiB", |point| (point.shm_bytes >> 20).to_string()),
    ("bound", |point| format!("{:.0}", point.bound_env_steps_per_s)),
    ("reached", |point| percent(Some(point.reached))),
    ("peak", |point| percent(point.peak_fraction)),
    ("device", |point| percent(point.device_fraction)),
];

fn micro(seconds: f64) -> String {
    format!("{:.0}", 1e6 * seconds)
}

fn milli(seconds: Option<f64>) -> String {
    seconds.map_or("–".to_owned(), |seconds| format!("{:.1}", 1e3 * seconds))
}

fn percent(fraction: Option<f64>) -> String {
    fraction.map_or("–".to_owned(), |fraction| format!("{:.0} %", 100.0 * fraction))
}

/// Returns the table that people read.
pub(crate) fn table(points: &[SpeedPoint]) -> String {
    let align = |idx| if idx < 2 { Align::Left } else { Align::Right };
    let columns = COLUMNS.iter().enumerate().map(|(idx, (name, _))| (*name, align(idx)));
    let mut table = TextTable::new(&columns.collect::<Vec<_>>());
    for point in points {
        table.row(COLUMNS.iter().map(|(_, text)| text(point)).collect());
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
    let all = json!({ "settings": settings, "points": points, "omitted": omissions });
    folder.write("fps.json", format!("{all:#}\n").as_bytes())?;
    let mut curves = Vec::new();
    for own in points.chunk_by(|a, b| a.series == b.series) {
        let name = own[0].series.name();
        folder.write(&format!("{name}.csv"), csv(own).as_bytes())?;
        let at = |point: &SpeedPoint| [f64::from(point.n_envs), point.env_steps_per_s];
        let is_fixed = |point: &&SpeedPoint| point.envs != Amount::Auto;
        let mut curve = Curve::joined(curves.len(), name, own.iter().filter(is_fixed).map(at).collect());
        let auto = own.iter().find(|point| !is_fixed(point));
        curve.mark = auto.map(|point| (at(point), point.envs_text()));
        curves.push(curve);
    }
    if let Some([svg, _]) = fps_svgs(&curves) {
        folder.write("fps.svg", svg.as_bytes())?;
    }
    Ok(())
}

/// Returns the columns that the original's script writes, and the number of envs as it was asked for.
fn csv(points: &[SpeedPoint]) -> String {
    let mut text = "batch_size,t_elapsed_sec,frames_per_second,seconds_per_frame,timesteps_per_task,\
        rlbench_estimated_total_sim_time_seconds,rlbench_estimated_total_sim_time_minutes,\
        rlbench_estimated_total_sim_time_hours,envs\n"
        .to_owned();
    for SpeedPoint { n_envs, envs, paper_fps, .. } in points {
        let elapsed = f64::from(*n_envs) * PAPER_STEPS / paper_fps;
        let total = EXTRAPOLATED_EPISODES * elapsed / f64::from(*n_envs);
        text += &format!(
            "{n_envs},{elapsed},{paper_fps},{},{PAPER_STEPS},{total},{},{},{envs}\n",
            1.0 / paper_fps,
            total / 60.0,
            total / 3600.0
        );
    }
    text
}
