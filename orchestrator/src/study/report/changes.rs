//! The table of the effects of perturbations.

use sim::Perturbation;
use sim::perturb::Composition;

use crate::console::table::{Align, TextTable};
use crate::store::results::Column;
use crate::study::analysis::{Effect, morphology_name};

/// Formats the effects as a table; empty without effects.
pub(crate) fn table(effects: &[Effect]) -> String {
    use Align::{Left, Right};
    if effects.is_empty() {
        return String::new();
    }
    let columns = [
        ("policy", Left),
        ("robot", Left),
        ("perturbation", Left),
        (Column::SuccessOnce.name(), Right),
        ("tasks", Right),
        ("change", Right),
        ("relative", Right),
    ];
    let mut table = TextTable::new(&columns);
    for effect in effects {
        let is_none = effect.perturbation == Composition::from(Perturbation::None);
        let change = |change: Option<f64>, unit: &str| match change {
            Some(change) if !is_none => format!("{:+.1} {unit}", 100.0 * change),
            _ => "–".to_owned(),
        };
        table.row(vec![
            effect.policy.clone(),
            morphology_name(effect.morphology).to_owned(),
            effect.perturbation.name(),
            format!("{:.1} %", 100.0 * effect.success),
            effect.n_tasks.to_string(),
            change(effect.change, "pp"),
            change(effect.relative_change, "%"),
        ]);
    }
    format!(
        "\n{table}change: mean of x − none over the tasks with at least 10 % unperturbed success; relative: mean of \
         (x − none) / none over the same tasks, so its sign can differ\n"
    )
}

#[cfg(test)]
mod tests {
    use super::table;

    #[test]
    fn table_is_empty_without_effects() {
        assert_eq!(table(&[]), "");
    }
}
