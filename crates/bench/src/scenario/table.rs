//! The tables of a scenario, in Markdown.

use super::figure::text_of;
use super::runner::Row;
use super::{Scenario, Table};
use crate::MeasureError;

/// Each table with its text.
///
/// # Errors
/// When a column names what is not there.
pub fn tables<'a>(scenario: &'a Scenario, rows: &[Row]) -> Result<Vec<(&'a Table, String)>, MeasureError> {
    let shown = |table: &&Table| match table.only_with.split_once('=') {
        Some((name, value)) => rows.iter().any(|row| row.bindings.get(name).is_some_and(|v| v == value)),
        None => true,
    };
    scenario.table.iter().filter(shown).map(|table| Ok((table, text(table, rows)?))).collect()
}

fn text(table: &Table, rows: &[Row]) -> Result<String, MeasureError> {
    let parts: Vec<Row>;
    let all: Vec<&Row> = match table.parts {
        true => {
            parts = rows.iter().flat_map(Row::parts).collect();
            parts.iter().collect()
        }
        false => rows.iter().collect(),
    };
    let mut out = table.title.clone();
    if !out.is_empty() {
        out += "\n\n";
    }
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | ")).replace("|  |", "| |");
    let heading = line(table.columns.iter().map(|column| column[0].clone()).collect());
    out += &heading;
    out += &format!("|{}\n", "---|".repeat(heading.matches('|').count() - 1));
    let mut groups = groups(&all, &table.by);
    if !table.also_by.is_empty() {
        groups.extend(self::groups(&all, &table.also_by));
    }
    for group in groups {
        let cells: Result<_, _> = table.columns.iter().map(|column| text_of(&column[1], &group)).collect();
        out += &line(cells?);
    }
    if !table.below.is_empty() {
        out += &format!("\n{}\n", text_of(&table.below, &all)?);
    }
    Ok(out)
}

/// The rows by their values of some bindings, in the order in which these first come; each by itself without any.
fn groups<'a>(rows: &[&'a Row], by: &[String]) -> Vec<Vec<&'a Row>> {
    if by.is_empty() {
        return rows.iter().map(|row| vec![*row]).collect();
    }
    let mut groups: Vec<(Vec<&String>, Vec<&'a Row>)> = Vec::new();
    for row in rows {
        let key: Vec<&String> = by.iter().filter_map(|name| row.bindings.get(name)).collect();
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    groups.into_iter().map(|(_, group)| group).collect()
}
