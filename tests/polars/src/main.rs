//! Prints a Parquet file as CSV, as polars reads it: names, then rows. Numbers have the fewest digits that tell them from
//! all others of their type, so that equal text is equal numbers. Other types than a campaign's are an error.
#![deny(warnings)]

use std::{env, error::Error, fs::File};

use polars_core::prelude::AnyValue;
use polars_io::{SerReader, parquet::read::ParquetReader};

fn main() -> Result<(), Box<dyn Error>> {
    let path = env::args().nth(1).ok_or("which file?")?;
    let table = ParquetReader::new(File::open(path)?).finish()?;
    let names: Vec<&str> = table.columns().iter().map(|column| column.name().as_str()).collect();
    println!("{}", names.join(","));
    for row in 0..table.height() {
        let cells = table.columns().iter().map(|column| match column.get(row)? {
            AnyValue::Int64(number) => Ok(number.to_string()),
            AnyValue::Float64(number) => Ok(number.to_string()),
            AnyValue::String(text) => Ok(text.to_owned()),
            other => Err(format!("{}, row {row}: {other:?}", column.name()).into()),
        });
        println!("{}", cells.collect::<Result<Vec<_>, Box<dyn Error>>>()?.join(","));
    }
    Ok(())
}
