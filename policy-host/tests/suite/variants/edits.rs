//! SettingChanges of a checkpoint folder, as `python/variants/edits.py` applies them for LeRobot.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::Deserialize;
use serde_json::Value;

/// A change of one file. Those of tensors apply to all whose name contains `part`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct CheckpointEdit {
    file: String,
    #[serde(flatten)]
    change: EditKind,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "op", rename_all = "lowercase")]
enum EditKind {
    Set { path: Vec<PathKey>, value: Value },
    Delete { path: Vec<PathKey> },
    Insert { idx: usize, step: Value },
    Pick { indices: Vec<usize> },
    Write { text: String },
    Remove,
    Copy { part: String, to: String, scale: f64 },
    Rename { part: String, to: String },
    Drop { part: String },
    Resize { name: String, shape: Vec<usize> },
    Fill { name: String, shape: Vec<usize>, values: Vec<f64> },
}

#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
enum PathKey {
    Index(usize),
    Name(String),
}

/// Shape and values of the tensors of a file.
type TensorMap = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

impl CheckpointEdit {
    pub(crate) fn apply(&self, folder: &Path) {
        let path = folder.join(&self.file);
        if let EditKind::Write { text } = &self.change {
            std::fs::write(&path, text).unwrap();
        } else if matches!(self.change, EditKind::Remove) {
            std::fs::remove_file(&path).unwrap();
        } else if path.extension().is_some_and(|extension| extension == "json") {
            let mut value: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            self.change.edit_json(&mut value);
            std::fs::write(&path, serde_json::to_vec_pretty(&value).unwrap()).unwrap();
        } else {
            let mut tensors = read(&path);
            self.change.edit_tensors(&mut tensors);
            write(&path, &tensors);
        }
    }
}

impl EditKind {
    fn edit_json(&self, value: &mut Value) {
        match self {
            Self::Set { path, value: new } => {
                let (parent, last) = parent(value, path);
                match last {
                    PathKey::Index(idx) => parent[idx] = new.clone(),
                    PathKey::Name(name) => parent[name] = new.clone(),
                }
            }
            Self::Delete { path } => {
                let (parent, last) = parent(value, path);
                let PathKey::Name(name) = last else { panic!("{last:?} is not the name of a key") };
                parent.as_object_mut().unwrap().remove(name).unwrap();
            }
            Self::Insert { idx, step } => steps(value).insert(*idx, step.clone()),
            Self::Pick { indices } => {
                let steps = steps(value);
                *steps = indices.iter().map(|&idx| steps[idx].clone()).collect();
            }
            _ => panic!("{self:?} does not apply to JSON"),
        }
    }

    fn edit_tensors(&self, tensors: &mut TensorMap) {
        let cycled = |values: &[f32], shape: &[usize]| {
            (shape.to_vec(), values.iter().copied().cycle().take(shape.iter().product()).collect())
        };
        match self {
            Self::Copy { part, to, scale } => {
                let copies =
                    tensors.iter().filter(|(name, _)| name.contains(part)).map(|(name, (shape, values))| {
                        let scaled = values.iter().map(|x| x * *scale as f32).collect();
                        (name.replace(part, to), (shape.clone(), scaled))
                    });
                tensors.extend(copies.collect::<Vec<_>>());
            }
            Self::Rename { part, to } => {
                *tensors = std::mem::take(tensors)
                    .into_iter()
                    .map(|(name, x)| (name.replace(part, to), x))
                    .collect();
            }
            Self::Drop { part } => tensors.retain(|name, _| !name.contains(part)),
            Self::Resize { name, shape } => {
                let resized = cycled(&tensors[name].1, shape);
                tensors.insert(name.clone(), resized);
            }
            Self::Fill { name, shape, values } => {
                let values: Vec<f32> = values.iter().map(|&x| x as f32).collect();
                tensors.insert(name.clone(), cycled(&values, shape));
            }
            _ => panic!("{self:?} does not apply to tensors"),
        }
    }
}

fn parent<'a, 'b>(value: &'a mut Value, path: &'b [PathKey]) -> (&'a mut Value, &'b PathKey) {
    let (last, parents) = path.split_last().unwrap();
    let parent = parents.iter().fold(value, |value, key| match key {
        PathKey::Index(idx) => &mut value[idx],
        PathKey::Name(name) => &mut value[name],
    });
    (parent, last)
}

fn steps(value: &mut Value) -> &mut Vec<Value> {
    value["steps"].as_array_mut().unwrap()
}

fn read(path: &Path) -> TensorMap {
    let bytes = std::fs::read(path).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let f32s = |view: &TensorView<'_>| {
        assert_eq!(view.dtype(), Dtype::F32, "{}", path.display());
        view.data().as_chunks::<4>().0.iter().map(|&x| f32::from_le_bytes(x)).collect()
    };
    tensors.tensors().iter().map(|(name, view)| (name.clone(), (view.shape().to_vec(), f32s(view)))).collect()
}

fn write(path: &Path, tensors: &TensorMap) {
    let views = tensors.iter().map(|(name, (shape, values))| {
        (name, TensorView::new(Dtype::F32, shape.clone(), bytemuck::cast_slice(values)).unwrap())
    });
    safetensors::serialize_to_file(views, None, path).unwrap();
}
