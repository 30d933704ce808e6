//! The action expert: a Gemma of smaller width that attends to the prefix and to the action rows, and whose
//! normalisations depend on the time of the flow (adaptive RMS normalisation).

use rayon::prelude::*;

use super::architecture::{GemmaConfig, Pi05Architecture};
use super::checkpoint::names::LayerStack;
use super::gemma::{CacheRows, GemmaAttention, GemmaMlp, KeyValueCache};
use super::layers::{EPSILON, LayerSource, in_row_blocks};
use crate::nn::gelu::silu;
use crate::nn::norm::rms_rows;
use crate::nn::projection::Projection;
use crate::nn::rotary::Rotary;
use crate::weights::WeightsError;

/// Periods of the time embedding, in units of the flow's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TimePeriods {
    pub(crate) min: f64,
    pub(crate) max: f64,
}

/// The action expert for a fixed list of times.
#[derive(Debug)]
pub(crate) struct ActionExpert {
    config: GemmaConfig,
    horizon: usize,
    action_width: usize,
    action_in_proj: Projection,
    action_out_proj: Projection,
    layers: Vec<(GemmaAttention, GemmaMlp)>,
    /// Normalisations at each time: two per layer, and the last one.
    modulations: Vec<Vec<Modulation>>,
}

/// An adaptive normalisation at one time: `x / rms(x) · scale + shift`, and a factor for what is computed
/// from it. Each is `[width]`.
#[derive(Clone, Debug)]
pub(crate) struct Modulation {
    /// One plus the network's scale.
    pub(crate) scale: Vec<f32>,
    pub(crate) shift: Vec<f32>,
    pub(crate) gate: Vec<f32>,
}

impl ActionExpert {
    /// Loads the expert and computes the normalisations at `times`, which depend on nothing else.
    pub(crate) fn load(
        source: LayerSource<'_>,
        architecture: &Pi05Architecture,
        times: &[f32],
        periods: TimePeriods,
    ) -> Result<Self, WeightsError> {
        let names = source.names;
        let config = architecture.expert;
        let root = |module: &'static str| move |tensor: &str| names.root(&format!("{module}.{tensor}"));
        let layer = |layer| -> Result<_, WeightsError> {
            let self_attn = GemmaAttention::load(source, LayerStack::Expert, layer)?;
            Ok((self_attn, GemmaMlp::load(source, LayerStack::Expert, layer)?))
        };
        Ok(Self {
            config,
            horizon: architecture.horizon,
            action_width: architecture.action_width,
            action_in_proj: source.exact_linear(root("action_in_proj"))?,
            action_out_proj: source.exact_linear(root("action_out_proj"))?,
            layers: (0..config.num_hidden_layers).map(layer).collect::<Result<_, _>>()?,
            modulations: modulations(source, config, times, periods)?,
        })
    }

    /// Returns the number of times.
    pub(crate) fn n_times(&self) -> usize {
        self.modulations.len()
    }

    /// Computes the velocities `[n, horizon, action_width]` of noisy actions of the same shape at a time. The
    /// cache holds the prefix of each of the `n` sequences; the rows behind it are overwritten.
    pub(crate) fn velocity(
        &self,
        actions: &[f32],
        time: usize,
        cache: &mut KeyValueCache,
        rotary: &Rotary,
    ) -> Vec<f32> {
        let width = self.config.hidden_size;
        let rows = CacheRows::Suffix(self.horizon);
        let mut x = vec![0.0; actions.len() / self.action_width * width];
        self.action_in_proj.forward(actions, &mut x);
        let (norms, last) = self.modulations[time].split_at(2 * self.layers.len());
        for (idx, (layer, norms)) in self.layers.iter().zip(norms.as_chunks::<2>().0).enumerate() {
            let (self_attn, mlp) = layer;
            let [input_layernorm, post_attention_layernorm] = norms;
            let mut out = input_layernorm.apply(&x);
            self_attn.forward(&mut out, (cache, idx), rows, rotary);
            input_layernorm.add_gated(&mut x, &out);
            in_row_blocks(&mut x, width, |x| {
                let mut out = post_attention_layernorm.apply(x);
                mlp.forward(&mut out);
                post_attention_layernorm.add_gated(x, &out);
            });
        }
        let x = last[0].apply(&x);
        let mut velocity = vec![0.0; actions.len()];
        self.action_out_proj.forward(&x, &mut velocity);
        velocity
    }
}

impl Modulation {
    /// Returns `x / rms(x) · scale + shift` for every row of `x`.
    fn apply(&self, x: &[f32]) -> Vec<f32> {
        let width = self.scale.len();
        let mut out = vec![0.0; x.len()];
        let rows = out.par_chunks_exact_mut(width).zip(x.par_chunks_exact(width));
        rows.for_each(|(out, row)| rms_rows(row, &self.scale, &self.shift, EPSILON, out));
        out
    }

    /// Computes `x += gate · y` for every row.
    fn add_gated(&self, x: &mut [f32], y: &[f32]) {
        let width = self.gate.len();
        x.par_chunks_exact_mut(width).zip(y.par_chunks_exact(width)).for_each(|(x, y)| {
            x.iter_mut().zip(y).zip(&self.gate).for_each(|((x, y), gate)| *x += y * gate);
        });
    }
}

/// Computes the normalisations at `times`: two per layer, and the last one.
pub(crate) fn modulations(
    source: LayerSource<'_>,
    config: GemmaConfig,
    times: &[f32],
    periods: TimePeriods,
) -> Result<Vec<Vec<Modulation>>, WeightsError> {
    let names = source.names;
    let root = |module: &'static str| move |tensor: &str| names.root(&format!("{module}.{tensor}"));
    let (time_mlp_in, time_mlp_out) =
        (source.exact_linear(root("time_mlp_in"))?, source.exact_linear(root("time_mlp_out"))?);
    let mut conditions = time_embedding(times, config.hidden_size, periods);
    let mut hidden = vec![0.0; conditions.len()];
    time_mlp_in.forward(&conditions, &mut hidden);
    silu(&mut hidden);
    time_mlp_out.forward(&hidden, &mut conditions);
    silu(&mut conditions);
    let mut by_norm = Vec::with_capacity(2 * config.num_hidden_layers + 1);
    for layer in 0..config.num_hidden_layers {
        for norm in ["input_layernorm", "post_attention_layernorm"] {
            let name =
                |tensor: &str| names.layer(LayerStack::Expert, layer, &format!("{norm}.dense.{tensor}"));
            by_norm.push(modulate(&source.exact_linear(name)?, &conditions, config.hidden_size));
        }
    }
    let last = source.exact_linear(|tensor| names.expert_norm(tensor))?;
    by_norm.push(modulate(&last, &conditions, config.hidden_size));
    let at_time = |time: usize| by_norm.iter().map(|norm| norm[time].clone()).collect();
    Ok((0..times.len()).map(at_time).collect())
}

/// Returns the normalisation at each of the times whose conditions `[times, width]` are given.
fn modulate(dense: &Projection, conditions: &[f32], width: usize) -> Vec<Modulation> {
    let mut out = vec![0.0; conditions.len() * 3];
    dense.forward(conditions, &mut out);
    let at_time = |row: &[f32]| Modulation {
        scale: row[..width].iter().map(|scale| 1.0 + scale).collect(),
        shift: row[width..2 * width].to_vec(),
        gate: row[2 * width..].to_vec(),
    };
    out.chunks_exact(3 * width).map(at_time).collect()
}

/// Returns the embedding `[times, width]`: sines, then cosines, of the time in units of periods that grow
/// geometrically.
fn time_embedding(times: &[f32], width: usize, periods: TimePeriods) -> Vec<f32> {
    let half = width / 2;
    let frequency = |idx: usize| {
        let fraction = if half > 1 { idx as f64 / (half - 1) as f64 } else { 0.0 };
        let period = periods.min * libm::pow(periods.max / periods.min, fraction);
        1.0 / period * 2.0 * std::f64::consts::PI
    };
    let of_time = |&time: &f32| {
        let angles = (0..half).map(move |idx| frequency(idx) * f64::from(time));
        let sines = angles.clone().map(|angle| libm::sin(angle) as f32);
        sines.chain(angles.map(|angle| libm::cos(angle) as f32))
    };
    times.iter().flat_map(of_time).collect()
}
