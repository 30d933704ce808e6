//! Parquet tables in the layout of pyarrow, which LeRobot and other readers expect.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

/// The name and the cells of a column.
pub(crate) type NamedCells = (String, Cells);

/// The cells of one column.
#[derive(Debug)]
pub(crate) enum Cells {
    Int(Vec<i64>),
    Float(Vec<f32>),
    Text(Vec<String>),
    /// Encoded image files, without paths.
    Image(Vec<Vec<u8>>),
    /// Lists of equal length: `[n_rows, width]`.
    FloatList {
        width: usize,
        numbers: Vec<f32>,
    },
    IntList(Vec<Vec<i64>>),
    TextList(Vec<Vec<String>>),
    /// Lists nested `depth` deep, whose inner lists have one element.
    DoubleList {
        depth: usize,
        lists: Vec<Vec<f64>>,
    },
}

/// A Parquet file being written.
pub(crate) struct ParquetTable(SerializedFileWriter<File>);

impl ParquetTable {
    /// Writes a whole file of one row group, with a key-value pair of metadata.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn write(
        path: &Path,
        columns: Vec<NamedCells>,
        metadata: Option<(&str, String)>,
    ) -> anyhow::Result<()> {
        let mut table = Self::create(path, &columns, metadata)?;
        table
            .push(columns)
            .and_then(|()| table.finish())
            .with_context(|| format!("failed to write {}", path.display()))
    }

    /// Creates a file with the schema of the columns `like` and a key-value pair of metadata.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(crate) fn create(
        path: &Path,
        like: &[NamedCells],
        metadata: Option<(&str, String)>,
    ) -> anyhow::Result<Self> {
        let fields = like.iter().map(|(name, cells)| cells.schema(name)).collect::<anyhow::Result<_>>()?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
        let metadata = metadata.map(|(key, value)| vec![KeyValue::new(key.to_owned(), value)]);
        let properties = WriterProperties::builder()
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None)
            .set_key_value_metadata(metadata)
            .build();
        let file = File::create(path).with_context(|| format!("failed to create {}", path.display()))?;
        Ok(Self(SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))?))
    }

    /// Appends rows as one row group.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(crate) fn push(&mut self, columns: Vec<NamedCells>) -> anyhow::Result<()> {
        let mut group = self.0.next_row_group()?;
        for (_, cells) in columns {
            cells.write(&mut group)?;
        }
        group.close()?;
        Ok(())
    }

    /// Writes the footer and syncs the file to disk.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        self.0.finish()?;
        self.0.inner().sync_all()?;
        Ok(())
    }
}

impl Cells {
    fn schema(&self, name: &str) -> anyhow::Result<TypePtr> {
        Ok(match self {
            Self::Int(_) => leaf(name, Physical::INT64, None)?,
            Self::Float(_) => leaf(name, Physical::FLOAT, None)?,
            Self::Text(_) => leaf(name, Physical::BYTE_ARRAY, Some(LogicalType::String))?,
            Self::Image(_) => {
                let bytes = leaf("bytes", Physical::BYTE_ARRAY, None)?;
                let path = leaf("path", Physical::BYTE_ARRAY, Some(LogicalType::String))?;
                group(name, Repetition::OPTIONAL, None, vec![bytes, path])?
            }
            Self::FloatList { .. } => list(name, 1, Physical::FLOAT, None)?,
            Self::IntList(_) => list(name, 1, Physical::INT64, None)?,
            Self::TextList(_) => list(name, 1, Physical::BYTE_ARRAY, Some(LogicalType::String))?,
            Self::DoubleList { depth, .. } => list(name, *depth, Physical::DOUBLE, None)?,
        })
    }

    fn write(self, group: &mut SerializedRowGroupWriter<'_, File>) -> anyhow::Result<()> {
        let text = |text: &String| ByteArray::from(text.as_str());
        match self {
            Self::Int(numbers) => leaves::<Int64Type>(group, &numbers, 1, None),
            Self::Float(numbers) => leaves::<FloatType>(group, &numbers, 1, None),
            Self::Text(texts) => {
                leaves::<ByteArrayType>(group, &texts.iter().map(text).collect::<Vec<_>>(), 1, None)
            }
            Self::Image(files) => {
                let bytes: Vec<ByteArray> = files.into_iter().map(ByteArray::from).collect();
                leaves::<ByteArrayType>(group, &bytes, 2, None)?;
                // The path is null in every row.
                let mut column = group.next_column()?.context("the schema of an image has a path")?;
                column.typed::<ByteArrayType>().write_batch(&[], Some(&vec![1; bytes.len()]), None)?;
                Ok(column.close()?)
            }
            Self::FloatList { width, numbers } => {
                let starts = |idx: usize| idx.is_multiple_of(width);
                let repeats: Vec<i16> = (0..numbers.len()).map(|idx| i16::from(!starts(idx))).collect();
                leaves::<FloatType>(group, &numbers, 3, Some(&repeats))
            }
            Self::IntList(lists) => leaves::<Int64Type>(group, &lists.concat(), 3, Some(&repeats(&lists))),
            Self::TextList(lists) => {
                let texts: Vec<ByteArray> = lists.iter().flatten().map(text).collect();
                leaves::<ByteArrayType>(group, &texts, 3, Some(&repeats(&lists)))
            }
            Self::DoubleList { depth, lists } => {
                leaves::<DoubleType>(group, &lists.concat(), 1 + 2 * depth as i16, Some(&repeats(&lists)))
            }
        }
    }
}

/// Returns the repetition levels of concatenated lists: 0 for the first element of a list, otherwise 1.
fn repeats<T>(lists: &[Vec<T>]) -> Vec<i16> {
    lists.iter().flat_map(|list| (0..list.len()).map(|idx| i16::from(idx > 0))).collect()
}

/// Writes one leaf column without nulls, so that every value has the maximum definition level.
fn leaves<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    definition: i16,
    repeats: Option<&[i16]>,
) -> anyhow::Result<()> {
    let mut column = group.next_column()?.context("the schema has a column for every field")?;
    column.typed::<T>().write_batch(values, Some(&vec![definition; values.len()]), repeats)?;
    Ok(column.close()?)
}

fn leaf(name: &str, physical: Physical, logical: Option<LogicalType>) -> anyhow::Result<TypePtr> {
    let leaf = Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
    Ok(Arc::new(leaf.with_logical_type(logical).build()?))
}

fn group(
    name: &str,
    repetition: Repetition,
    logical: Option<LogicalType>,
    fields: Vec<TypePtr>,
) -> anyhow::Result<TypePtr> {
    let group = Type::group_type_builder(name).with_repetition(repetition).with_logical_type(logical);
    Ok(Arc::new(group.with_fields(fields).build()?))
}

fn list(
    name: &str,
    depth: usize,
    physical: Physical,
    logical: Option<LogicalType>,
) -> anyhow::Result<TypePtr> {
    let element = if depth == 1 {
        leaf("element", physical, logical)?
    } else {
        list("element", depth - 1, physical, logical)?
    };
    let entries = group("list", Repetition::REPEATED, None, vec![element])?;
    group(name, Repetition::OPTIONAL, Some(LogicalType::List), vec![entries])
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};

    use super::*;

    #[test]
    fn every_kind_of_column_round_trips() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("table.parquet");
        let columns = || {
            vec![
                ("int".to_owned(), Cells::Int(vec![7, 8])),
                ("float".to_owned(), Cells::Float(vec![0.5, -0.25])),
                ("text".to_owned(), Cells::Text(vec!["a".to_owned(), String::new()])),
                ("image".to_owned(), Cells::Image(vec![vec![1, 2], vec![255]])),
                ("floats".to_owned(), Cells::FloatList { width: 2, numbers: vec![1.0, 2.0, 3.0, 4.0] }),
                ("ints".to_owned(), Cells::IntList(vec![vec![1], vec![2, 3]])),
                ("texts".to_owned(), Cells::TextList(vec![vec!["x".to_owned()], vec!["y".to_owned()]])),
                (
                    "doubles/1".to_owned(),
                    Cells::DoubleList { depth: 1, lists: vec![vec![0.1], vec![0.2, 0.3]] },
                ),
                (
                    "doubles/3".to_owned(),
                    Cells::DoubleList { depth: 3, lists: vec![vec![0.1, 0.4], vec![0.2]] },
                ),
            ]
        };
        let mut table = ParquetTable::create(&path, &columns(), Some(("key", "value".to_owned()))).unwrap();
        table.push(columns()).unwrap();
        table.push(columns()).unwrap();
        table.finish().unwrap();
        let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let rows: Vec<String> =
            reader.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect();
        assert_eq!(rows[..2], rows[2..], "one row group per push");
        insta::assert_snapshot!(rows[..2].join("\n"), @r#"
        {int: 7, float: 0.5, text: "a", image: {bytes: [1, 2], path: null}, floats: [1.0, 2.0], ints: [1], texts: ["x"], doubles/1: [0.1], doubles/3: [[[0.1]], [[0.4]]]}
        {int: 8, float: -2.5E-1, text: "", image: {bytes: [255], path: null}, floats: [3.0, 4.0], ints: [2, 3], texts: ["y"], doubles/1: [0.2, 0.3], doubles/3: [[[0.2]]]}
        "#);
    }
}
