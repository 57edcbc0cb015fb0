//! The rows of a campaign as a Parquet file, as polars, duckdb and pandas read it.

use std::io;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{Type, TypePtr};

use super::runs::Row;

/// Rows of a row group: whoever reads only some columns reads little, and memory stays small.
const GROUP: usize = 1 << 20;

/// A column: its name and its values.
type Column = (&'static str, Values);

enum Values {
    Whole(fn(&Row) -> i64),
    Real(fn(&Row) -> f64),
    Text(fn(&Row) -> &'static str),
}

/// As the columns of the CSV.
const COLUMNS: [Column; 9] = [
    ("run", Values::Whole(|row| row.run as i64)),
    ("seed", Values::Whole(|row| row.seed as i64)),
    ("method", Values::Text(|row| row.method.name())),
    ("density_per_km2", Values::Real(|row| row.density_per_km2)),
    ("r_e_m", Values::Real(|row| row.r_e_m)),
    ("drones", Values::Whole(|row| i64::from(row.drones))),
    ("users", Values::Whole(|row| row.users as i64)),
    ("served_guaranteed", Values::Whole(|row| row.served_guaranteed as i64)),
    ("served_actual", Values::Whole(|row| row.served_actual as i64)),
];

/// The whole file; the same rows give the same bytes.
pub(super) fn encode(rows: &[Row]) -> io::Result<Vec<u8>> {
    write(rows).map_err(io::Error::other)
}

fn write(rows: &[Row]) -> Result<Vec<u8>> {
    // The program's own name, so that an update of the library alone changes no byte of the footer.
    let properties = WriterProperties::builder().set_created_by("skyroost campaign".to_owned()).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema()?, Arc::new(properties))?;
    for group in rows.chunks(GROUP) {
        let mut columns = writer.next_row_group()?;
        for (_, values) in &COLUMNS {
            let Some(mut column) = columns.next_column()? else { break };
            match values {
                Values::Whole(of) => {
                    let values: Vec<i64> = group.iter().map(of).collect();
                    column.typed::<Int64Type>().write_batch(&values, None, None)?;
                }
                Values::Real(of) => {
                    let values: Vec<f64> = group.iter().map(of).collect();
                    column.typed::<DoubleType>().write_batch(&values, None, None)?;
                }
                Values::Text(of) => {
                    let values: Vec<ByteArray> = group.iter().map(|row| ByteArray::from(of(row))).collect();
                    column.typed::<ByteArrayType>().write_batch(&values, None, None)?;
                }
            }
            column.close()?;
        }
        columns.close()?;
    }
    writer.into_inner()
}

fn schema() -> Result<TypePtr> {
    let field = |(name, values): &Column| {
        let (physical, logical) = match values {
            Values::Whole(_) => (Physical::INT64, None),
            Values::Real(_) => (Physical::DOUBLE, None),
            Values::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let builder = Type::primitive_type_builder(name, physical).with_repetition(Repetition::REQUIRED);
        Ok(Arc::new(builder.with_logical_type(logical).build()?))
    };
    let fields = COLUMNS.iter().map(field).collect::<Result<Vec<TypePtr>>>()?;
    Ok(Arc::new(Type::group_type_builder("results").with_fields(fields).build()?))
}
