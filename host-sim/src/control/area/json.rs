//! JSON whose faults are found again in the file.
//!
//! Values are taken apart by hand: a derived reader would name the type that it missed, not the vertex.
//! Numbers are asked for by `as_f64`, which understands them whether serde_json keeps them as floats or
//! (with the feature `arbitrary_precision`, which a crate for the boards' logs switches on) as text.

use serde_json::Value;

use super::fault::{Fault, quoted};

/// The whole file. Nesting beyond 128 levels is refused by serde_json, so nothing below can recurse deeper.
pub(super) fn parse(text: &str, format: &str) -> Result<Value, Fault> {
    serde_json::from_str(text).map_err(|e| {
        let message = e.to_string();
        let found = message.rsplit_once(" at line ").map_or(message.as_str(), |(what, _)| what);
        Fault::content(format!("line {}, column {}", e.line(), e.column()), found, format)
    })
}

/// A member of an object; null counts as none.
pub(super) fn member<'a>(value: &'a Value, name: &str) -> Option<&'a Value> {
    value.get(name).filter(|member| !member.is_null())
}

/// A member that has to be an array.
pub(super) fn array_member<'a>(value: &'a Value, name: &str, place: &str) -> Result<&'a [Value], Fault> {
    match member(value, name) {
        Some(member) => array(member, &format!("{place}, {name:?}")),
        None => Err(Fault::content(place, format!("no {name:?}"), format!("an array {name:?}"))),
    }
}

/// A value that has to be an array.
pub(super) fn array<'a>(value: &'a Value, place: &str) -> Result<&'a [Value], Fault> {
    value.as_array().map(Vec::as_slice).ok_or_else(|| Fault::content(place, described(value), "an array"))
}

/// The first two numbers of an array; what follows, as a height does, is ignored.
pub(super) fn pair(value: &Value, place: &str, expected: &str) -> Result<[f64; 2], Fault> {
    let number = |value: &Value| {
        value.as_f64().ok_or_else(|| Fault::content(place, described(value), format!("{expected}, finite")))
    };
    match array(value, place)? {
        [a, b, ..] => Ok([number(a)?, number(b)?]),
        short => Err(Fault::content(place, format!("{} numbers", short.len()), expected)),
    }
}

/// A value as a message shows it.
pub(super) fn described(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(is) => is.to_string(),
        Value::Number(number) => quoted(&number.to_string()).replace('"', ""),
        Value::String(text) => quoted(text),
        Value::Array(values) => format!("an array of {}", values.len()),
        Value::Object(_) => "an object".into(),
    }
}
