//! Figures in the texts of tables.
//!
//! `{ate_m:4}` is a field of the run's figures with four digits, `{world}` a binding. Over several runs an aggregate comes first, and
//! a condition may follow: `{median drift_percent where seeds=fixed:2}`. Aggregates are `min`, `median` (the upper one), `max`,
//! `mean`, `sum`, `count` (of known values) and `some` (of values that are neither zero nor empty); what is not known is left out,
//! and an aggregate over nothing is "-". `{A / B:2}` is the ratio of two of them, and `{A / B:over 1.2}` whether that is more.

use super::runner::Row;
use crate::MeasureError;
use serde_json::Value;

/// A text with the figures of these rows.
///
/// # Errors
/// When a field or binding is not there, or an aggregate is unknown.
pub fn text_of(text: &str, rows: &[&Row]) -> Result<String, MeasureError> {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once('{') {
        let (inside, after) = after.split_once('}').ok_or_else(|| format!("no end of {{ in {text:?}"))?;
        out += before;
        out += &one(inside, rows)?;
        rest = after;
    }
    Ok(out + rest)
}

fn one(inside: &str, rows: &[&Row]) -> Result<String, MeasureError> {
    let (what, form) = inside.rsplit_once(':').unwrap_or((inside, ""));
    if let Some((a, b)) = what.split_once(" / ") {
        let ratio = number(a, rows)?.zip(number(b, rows)?).map(|(a, b)| a / b);
        return Ok(match form.strip_prefix("over ") {
            Some(most) => {
                let most: f64 = most.parse().map_err(|_| format!("{most:?} is no number"))?;
                if ratio.is_some_and(|ratio| ratio > most) { "**yes**" } else { "no" }.into()
            }
            None => shown(ratio, digits(form)?),
        });
    }
    if what.contains(' ') {
        return Ok(shown(number(what, rows)?, digits(form)?));
    }
    let mut texts: Vec<String> = Vec::new();
    for row in rows {
        let text = match row.value(what)? {
            Value::Number(n) if !form.is_empty() => shown(n.as_f64(), digits(form)?),
            Value::String(text) => text,
            Value::Null => "-".into(),
            other => other.to_string(),
        };
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    // A binding that differs among the rows of a group.
    Ok(if texts.len() == 1 { texts.remove(0) } else { "all".into() })
}

fn digits(form: &str) -> Result<usize, MeasureError> {
    match form {
        "" => Ok(0),
        form => form.parse().map_err(|_| format!("{form:?} is no number of digits").into()),
    }
}

fn shown(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |v| format!("{v:.digits$}"))
}

/// `AGGREGATE FIELD`, perhaps with `where BINDING=VALUE`.
fn number(what: &str, rows: &[&Row]) -> Result<Option<f64>, MeasureError> {
    let (what, condition) = what.split_once(" where ").unwrap_or((what, ""));
    let (aggregate, field) = what.split_once(' ').ok_or_else(|| format!("{what:?} has no aggregate"))?;
    let mut values = Vec::new();
    for row in rows {
        if let Some((name, value)) = condition.split_once('=')
            && row.bindings.get(name).is_none_or(|bound| bound != value)
        {
            continue;
        }
        values.extend(match row.value(field)? {
            Value::Number(n) => n.as_f64(),
            Value::Bool(is) => Some(f64::from(u8::from(is))),
            Value::Array(list) => Some(list.len() as f64),
            Value::String(text) => text.parse().ok().or(Some(0.0)),
            _ => None,
        });
    }
    values.sort_by(f64::total_cmp);
    let (sum, count) = (values.iter().sum::<f64>(), values.len() as f64);
    match aggregate {
        "min" => Ok(values.first().copied()),
        "median" => Ok(values.get(values.len() / 2).copied()),
        "max" => Ok(values.last().copied()),
        "mean" => Ok((!values.is_empty()).then(|| sum / count)),
        "sum" => Ok(Some(sum)),
        "count" => Ok(Some(count)),
        "some" => Ok(Some(values.iter().filter(|v| **v != 0.0).count() as f64)),
        other => Err(format!("there is no aggregate {other:?}").into()),
    }
}
