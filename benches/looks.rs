//! Likeness of our camera images to those of the original simulator, at the same start states.
//!
//! `cargo bench -p benches --bench looks -- --frames DIR --starts DIR [--sheet FILE] [--csv FILE]`. The
//! folder of `--frames` holds the original images, `ENV_ID.SEED.CAMERA.png`, that of `--starts` their
//! start states, `ENV_ID.SEED.json` (docs/trajectories.md; `python/convert_recordings.py` converts
//! recordings). Each start is put into our scene of the task, drawn by the CPU renderer and compared
//! camera by camera. Two figures are reported, lower is better: the mean absolute difference of the means
//! of 8 × 8 pixels, in codes from 0 to 255, and the share of pixels with an edge in one image that has
//! none within a pixel in the other. `--sheet` writes ours | original, a row per camera.

#![expect(clippy::print_stdout, reason = "a benchmark reports on standard output")]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use benches::Report;
use ipc_types::{ImageSize, ImageSizes};
use sim::physics::Parameters;
use sim::render::{CpuRenderer, RenderScene};
use sim::scene::{CameraSlot, Snapshot};
use sim::show::contact_sheet::{self, Panel};
use sim::trajectory::{Start, TrajectoryFile};

/// Side of the blocks whose means are compared, in pixels.
const BLOCK: usize = 8;
/// Sobel magnitude of the luminance above which a pixel has an edge: a step of 32 codes.
const EDGE: f32 = 128.0;

fn main() -> Result<()> {
    let (mut frames, mut starts, mut sheet) = (None, None, None);
    let usage = "--frames DIR, --starts DIR, --sheet FILE, ";
    let mut report = Report::with_options("looks", usage, |flag, value| {
        match flag {
            "--frames" => frames = Some(PathBuf::from(value)),
            "--starts" => starts = Some(PathBuf::from(value)),
            "--sheet" => sheet = Some(PathBuf::from(value)),
            _ => return Ok(false),
        }
        Ok(true)
    })?;
    let frames = frames.context("--frames DIR is required")?;
    let starts = starts.context("--starts DIR is required")?;
    let mut likeness: BTreeMap<&str, Vec<Likeness>> = BTreeMap::new();
    let mut images = Vec::new();
    for start in sorted_files(&starts)? {
        let name = start.file_stem().and_then(|stem| stem.to_str()).context("a file name is not UTF-8")?;
        let cameras = frames_of(name, &frames)?;
        if cameras.is_empty() {
            continue;
        }
        let rendered = render(&start).with_context(|| format!("draw {}", start.display()))?;
        for (camera, ours) in rendered {
            let Some(original) = cameras.get(camera) else { continue };
            ensure!(ours.side == original.side, "{name} {camera}: {} px, not {}", original.side, ours.side);
            let figures = Likeness::of(&ours, original);
            print_row(&format!("{name} {camera}"), figures);
            for (figure, value, unit) in figures.named() {
                report.add(&format!("{name}/{camera}/{figure}"), value.into(), unit, "");
            }
            likeness.entry(camera).or_default().push(figures);
            images.extend([ours, original.clone()].map(|image| (ImageSize::square(image.side), image.rgb)));
        }
    }
    ensure!(!images.is_empty(), "no start in {} has frames in {}", starts.display(), frames.display());
    for (camera, figures) in &likeness {
        print_row(&format!("mean of {} {camera}", figures.len()), Likeness::mean(figures));
    }
    let all: Vec<Likeness> = likeness.into_values().flatten().collect();
    let worst = all.iter().fold(0.0, |worst, figures| f32::max(worst, figures.block_difference));
    print_row(&format!("mean of {}", all.len()), Likeness::mean(&all));
    println!("largest block difference {worst:.1}");
    if let Some(path) = sheet {
        let panels: Vec<_> =
            images.into_iter().map(|image| Panel { caption: String::new(), images: vec![image] }).collect();
        contact_sheet::compose(&panels, 6, 2).write_png(&path)?;
    }
    report.finish()
}

fn print_row(name: &str, figures: Likeness) {
    let [blocks, edges] = figures.named().map(|(_, value, _)| value);
    println!("{name:56} blocks {blocks:5.1} codes, edges {edges:5.1} %");
}

/// Files of a folder in alphabetical order.
fn sorted_files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| format!("read {}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    files.sort();
    Ok(files)
}

/// Name that the benchmark gives to a camera of a scene with `n_arms` arms.
const fn camera_name(slot: CameraSlot, n_arms: usize) -> &'static str {
    match (slot, n_arms) {
        (CameraSlot::External1, _) => "external1_camera",
        (CameraSlot::External2, _) => "external2_camera",
        (CameraSlot::Hand1, 1) => "hand_camera",
        (CameraSlot::Hand1, _) => "panda1_hand_camera",
        (CameraSlot::Hand2, _) => "panda2_hand_camera",
    }
}

/// Returns the original frames of a start by camera.
fn frames_of(start: &str, frames: &Path) -> Result<BTreeMap<String, CameraImage>> {
    let mut images = BTreeMap::new();
    for file in sorted_files(frames)? {
        let name = file.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let camera = name.strip_prefix(start).and_then(|rest| rest.strip_prefix('.')?.strip_suffix(".png"));
        if let Some(camera) = camera {
            let image = CameraImage::read(&file).with_context(|| format!("read {}", file.display()))?;
            images.insert(camera.to_owned(), image);
        }
    }
    Ok(images)
}

/// Draws all cameras of a recorded start state.
fn render(path: &Path) -> Result<Vec<(&'static str, CameraImage)>> {
    let start = Start::resolve(&TrajectoryFile::read(path)?, path)?;
    let scene = &start.scene;
    let mut snapshot = Snapshot::identity(scene.bodies.len(), scene.robots.len());
    start.world(&Parameters::default()).write_snapshot(&mut snapshot);
    let images =
        CpuRenderer::new(1).render_cameras(&RenderScene::new(scene, ImageSizes::BENCHMARK), &snapshot);
    let names = scene.cameras.iter().map(|camera| camera_name(camera.slot, scene.robots.len()));
    Ok(names.zip(images.into_iter().map(|(size, rgb)| CameraImage { side: size.width, rgb })).collect())
}

/// A square image, `[side, side, 3] u8` sRGB.
#[derive(Clone)]
struct CameraImage {
    side: usize,
    rgb: Vec<u8>,
}

impl CameraImage {
    /// Reads a PNG file with three or four 8-bit channels.
    fn read(path: &Path) -> Result<Self> {
        let mut reader = png::Decoder::new(BufReader::new(File::open(path)?)).read_info()?;
        let mut bytes = vec![0; reader.output_buffer_size().context("the image is too large")?];
        let info = reader.next_frame(&mut bytes)?;
        let n_channels = info.color_type.samples();
        ensure!(
            info.width == info.height && n_channels >= 3 && info.bit_depth == png::BitDepth::Eight,
            "expected a square image of 8-bit RGB"
        );
        let rgb = bytes.chunks_exact(n_channels).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        Ok(Self { side: info.width as usize, rgb })
    }

    /// Returns the mean of each channel of each block, row-major.
    fn block_means(&self) -> Vec<f32> {
        let n = self.side / BLOCK;
        let mut means = vec![0.0; n * n * 3];
        for (i, code) in self.rgb.iter().enumerate() {
            let (y, x, channel) = (i / 3 / self.side, i / 3 % self.side, i % 3);
            means[(y / BLOCK * n + x / BLOCK) * 3 + channel] += f32::from(*code) / (BLOCK * BLOCK) as f32;
        }
        means
    }

    /// Returns whether each inner pixel has an edge; those on the border have none.
    fn edges(&self) -> Vec<bool> {
        let luminance = |pixel: &[u8; 3]| {
            let [r, g, b] = pixel.map(f32::from);
            0.299 * r + 0.587 * g + 0.114 * b
        };
        let grey: Vec<f32> = self.rgb.as_chunks().0.iter().map(luminance).collect();
        let at = |x: usize, y: usize| grey[y * self.side + x];
        // Weighted sums over the three pixels before or after (x, y).
        let column = |x: usize, y: usize| at(x, y - 1) + 2.0 * at(x, y) + at(x, y + 1);
        let row = |x: usize, y: usize| at(x - 1, y) + 2.0 * at(x, y) + at(x + 1, y);
        let inner = 1..self.side - 1;
        let edge = |i: usize| {
            let (x, y) = (i % self.side, i / self.side);
            let is_inner = inner.contains(&x) && inner.contains(&y);
            let gradient = || [column(x + 1, y) - column(x - 1, y), row(x, y + 1) - row(x, y - 1)];
            is_inner && gradient().map(|slope| slope * slope).iter().sum::<f32>() > EDGE * EDGE
        };
        (0..grey.len()).map(edge).collect()
    }
}

/// Figures of a pair of images, or their mean over several.
#[derive(Clone, Copy)]
struct Likeness {
    /// Mean absolute difference of block means, in codes.
    block_difference: f32,
    /// Share of pixels with an edge in one image only.
    edge_difference: f32,
}

impl Likeness {
    fn of(ours: &CameraImage, original: &CameraImage) -> Self {
        let (a, b) = (ours.block_means(), original.block_means());
        let differences = a.iter().zip(&b).map(|(a, b)| (a - b).abs());
        let edges = [ours.edges(), original.edges()];
        let side = ours.side;
        let missing = |i: usize, of: &[bool], within: &[bool]| {
            let (x, y) = (i % side, i / side);
            of[i] && !(y - 1..=y + 1).any(|y| within[y * side + x - 1..=y * side + x + 1].contains(&true))
        };
        let is_missing = |i: &usize| missing(*i, &edges[0], &edges[1]) || missing(*i, &edges[1], &edges[0]);
        let n_missing = (0..side * side).filter(is_missing).count();
        Self {
            block_difference: differences.sum::<f32>() / a.len() as f32,
            edge_difference: n_missing as f32 / (side * side) as f32,
        }
    }

    fn mean(all: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f32| all.iter().map(of).sum::<f32>() / all.len() as f32;
        Self {
            block_difference: mean(|figures| figures.block_difference),
            edge_difference: mean(|figures| figures.edge_difference),
        }
    }

    fn named(self) -> [(&'static str, f32, &'static str); 2] {
        [("blocks", self.block_difference, "codes"), ("edges", 100.0 * self.edge_difference, "%")]
    }
}
