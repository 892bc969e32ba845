//! The table of all jobs as Parquet.

use super::row::{Row, cell};
use crate::{Error, Result};
use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::types::{Type, TypePtr};
use serde_json::Value as Json;
use std::sync::Arc;

/// The rows as a file: whole numbers, numbers, truth values or text by column; cells may be missing.
///
/// # Errors
/// The crate `parquet` fails, which no input should cause.
pub fn parquet(columns: &[String], rows: &[Row]) -> Result<Vec<u8>> {
    write(columns, rows).map_err(|e| Error::format("results.parquet", None, e.to_string()))
}

fn write(columns: &[String], rows: &[Row]) -> std::result::Result<Vec<u8>, ParquetError> {
    let types: Vec<Physical> = columns.iter().map(|name| type_of(rows, name)).collect();
    let fields = columns.iter().zip(&types).map(|(name, kind)| field(name, *kind));
    let fields = fields.collect::<std::result::Result<Vec<_>, _>>()?;
    let schema = Type::group_type_builder("results").with_fields(fields).build()?;
    let mut file = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::default())?;
    let mut group = file.next_row_group()?;
    for (name, kind) in columns.iter().zip(types) {
        let Some(column) = group.next_column()? else { break };
        let cells: Vec<Option<&Json>> = rows.iter().map(|row| given(row, name)).collect();
        let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
        write_column(column, kind, &cells.into_iter().flatten().collect::<Vec<_>>(), &levels)?;
    }
    group.close()?;
    file.into_inner()
}

fn given<'a>(row: &'a Row, column: &str) -> Option<&'a Json> {
    row.get(column).filter(|value| !value.is_null())
}

/// The type that holds all cells of a column.
fn type_of(rows: &[Row], column: &str) -> Physical {
    let all = |suits: fn(&Json) -> bool| rows.iter().filter_map(|row| given(row, column)).all(suits);
    match () {
        () if all(Json::is_i64) => Physical::INT64,
        () if all(Json::is_number) => Physical::DOUBLE,
        () if all(Json::is_boolean) => Physical::BOOLEAN,
        () => Physical::BYTE_ARRAY,
    }
}

fn field(name: &str, kind: Physical) -> std::result::Result<TypePtr, ParquetError> {
    let builder = Type::primitive_type_builder(name, kind).with_repetition(Repetition::OPTIONAL);
    let text = if kind == Physical::BYTE_ARRAY { ConvertedType::UTF8 } else { ConvertedType::NONE };
    Ok(Arc::new(builder.with_converted_type(text).build()?))
}

/// Writes the cells that are given; `levels` are 1 for these and 0 for the others.
fn write_column(
    mut column: SerializedColumnWriter<'_>,
    kind: Physical,
    cells: &[&Json],
    levels: &[i16],
) -> std::result::Result<(), ParquetError> {
    let levels = Some(levels);
    match kind {
        Physical::INT64 => {
            let values: Vec<i64> = cells.iter().filter_map(|cell| cell.as_i64()).collect();
            column.typed::<Int64Type>().write_batch(&values, levels, None)?
        }
        Physical::DOUBLE => {
            let values: Vec<f64> = cells.iter().filter_map(|cell| cell.as_f64()).collect();
            column.typed::<DoubleType>().write_batch(&values, levels, None)?
        }
        Physical::BOOLEAN => {
            let values: Vec<bool> = cells.iter().filter_map(|cell| cell.as_bool()).collect();
            column.typed::<BoolType>().write_batch(&values, levels, None)?
        }
        _ => {
            let text = |value: &&Json| ByteArray::from(cell(Some(value)).into_bytes());
            let values: Vec<ByteArray> = cells.iter().map(text).collect();
            column.typed::<ByteArrayType>().write_batch(&values, levels, None)?
        }
    };
    column.close()
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    use serde_json::json;

    #[test]
    fn the_table_is_read_as_it_was_written() {
        let rows: Vec<Row> = [
            json!({ "job": "a", "n": 3, "x": 0.5, "yes": true, "mixed": 1 }),
            json!({ "job": "ä b", "n": null, "x": 2, "mixed": "two" }),
        ]
        .map(|row| row.as_object().expect("an object").clone())
        .into();
        let columns = ["job", "n", "x", "yes", "mixed"].map(String::from);
        let path = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(path.path(), parquet(&columns, &rows).expect("a table")).expect("written");
        let file = SerializedFileReader::new(std::fs::File::open(path.path()).expect("opened"));
        let file = file.expect("Parquet");
        let found: Vec<_> = file.get_row_iter(None).expect("rows").map(|row| row.expect("a row")).collect();
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].get_string(0).expect("text"), "ä b");
        assert_eq!((found[0].get_long(1).expect("a number"), found[1].get_long(1).is_err()), (3, true));
        assert_eq!([0, 1].map(|k: usize| found[k].get_double(2).expect("a number")), [0.5, 2.0]);
        assert!(found[0].get_bool(3).expect("a truth value"));
        assert_eq!([0, 1].map(|k: usize| found[k].get_string(4).expect("text").as_str()), ["1", "two"]);
    }
}
