//! How old the figures of the documents are: for each table with numbers in `docs/` the commit at which its oldest row was
//! written, and how many commits have changed the code since. Rows that nobody has measured again are at the top.

use crate::MeasureError;
use crate::error::of;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// A table of a page.
#[derive(Clone, Debug, PartialEq)]
pub struct Figures {
    /// The page, below the root of the checkout.
    pub page: String,
    /// The heading above it.
    pub heading: String,
    /// Rows with numbers.
    pub rows: usize,
    /// The commit of the row that was written longest ago; all zeros where it is not committed.
    pub commit: String,
    /// When that was, as YYYY-MM-DD.
    pub day: String,
    /// Commits since then that changed Rust code.
    pub since: usize,
}

/// The tables with figures of all pages in `docs/` of a checkout, the oldest first.
/// Rows that moved from one page to another keep their age.
///
/// # Errors
/// When git does not answer.
pub fn run(root: &Path) -> Result<Vec<Figures>, MeasureError> {
    let pages = git(root, &["ls-files", "docs/*.md", "README.md"])?;
    let mut since: BTreeMap<String, usize> = BTreeMap::new();
    let mut all = Vec::new();
    for page in pages.lines() {
        let blame = git(root, &["blame", "-C", "--line-porcelain", "--", page])?;
        for mut table in tables(page, &blame) {
            if !since.contains_key(&table.commit) {
                let range = format!("{}..HEAD", table.commit);
                let count = git(root, &["rev-list", "--count", "--no-merges", &range, "--", "*.rs"]);
                let count = count.ok().and_then(|n| n.trim().parse().ok()).unwrap_or(0);
                since.insert(table.commit.clone(), count);
            }
            table.since = since[&table.commit];
            all.push(table);
        }
    }
    all.sort_by(|a, b| b.since.cmp(&a.since).then(a.page.cmp(&b.page)));
    Ok(all)
}

/// The tables with numbers of a page, from `git blame --line-porcelain`.
fn tables(page: &str, blame: &str) -> Vec<Figures> {
    let (mut found, mut current): (Vec<Figures>, Option<(Figures, i64)>) = (Vec::new(), None);
    let (mut heading, mut commit, mut seconds) = (String::new(), "", 0i64);
    for line in blame.lines() {
        let Some(text) = line.strip_prefix('\t') else {
            match line.split_once(' ') {
                Some(("committer-time", at)) => seconds = at.parse().unwrap_or(0),
                Some((id, _)) if id.len() == 40 && id.bytes().all(|b| b.is_ascii_hexdigit()) => commit = id,
                _ => {}
            }
            continue;
        };
        if !text.starts_with('|') {
            found.extend(current.take().map(|(table, _)| table));
            if let Some(title) = text.strip_prefix('#') {
                heading = title.trim_start_matches('#').trim().to_owned();
            }
            continue;
        }
        // A row of figures: a number stands in a column behind the first.
        if !text.split('|').skip(2).any(|cell| cell.trim().starts_with(|c: char| c.is_ascii_digit())) {
            continue;
        }
        let (table, oldest) = current.get_or_insert_with(|| {
            let heading = heading.clone();
            let (commit, day) = (String::new(), String::new());
            (Figures { page: page.to_owned(), heading, rows: 0, commit, day, since: 0 }, i64::MAX)
        });
        table.rows += 1;
        if seconds < *oldest {
            (*oldest, table.commit, table.day) = (seconds, commit.to_owned(), day(seconds));
        }
    }
    found.extend(current.take().map(|(table, _)| table));
    found
}

/// The day of seconds since 1970, in UTC (Hinnant, "chrono-compatible low-level date algorithms").
fn day(seconds: i64) -> String {
    let z = seconds.div_euclid(86_400) + 719_468;
    let era = z.div_euclid(146_097);
    let of_era = z.rem_euclid(146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let (d, m) = (of_year - (153 * month + 2) / 5 + 1, if month < 10 { month + 3 } else { month - 9 });
    format!("{:04}-{m:02}-{d:02}", year + era * 400 + i64::from(m <= 2))
}

/// As a table in Markdown.
pub fn table(all: &[Figures]) -> String {
    let mut out = String::from(
        "| page | heading | rows | oldest row written at | day | commits to the code since |\n|---|---|---|---|---|---|\n",
    );
    for f in all {
        let commit = &f.commit[..f.commit.len().min(7)];
        let _ =
            writeln!(out, "| {} | {} | {} | {commit} | {} | {} |", f.page, f.heading, f.rows, f.day, f.since);
    }
    out
}

fn git(root: &Path, arguments: &[&str]) -> Result<String, MeasureError> {
    let out = Command::new("git").arg("-C").arg(root).args(arguments).output();
    let out = out.map_err(|e| of("git", e))?;
    match out.status.success() {
        true => Ok(String::from_utf8_lossy(&out.stdout).into_owned()),
        false => {
            let said = String::from_utf8_lossy(&out.stderr).trim().to_owned();
            Err(of(format!("git {}", arguments.join(" ")), MeasureError::from(said)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(commit: char, seconds: i64, text: &str) -> String {
        format!(
            "{} 1 1 1\nauthor A\ncommitter-time {seconds}\nfilename x.md\n\t{text}\n",
            commit.to_string().repeat(40)
        )
    }

    #[test]
    fn the_oldest_row_of_each_table_is_found_and_words_are_no_figures() {
        let day_s = 86_400;
        let blame = [
            line('a', 0, "# A page"),
            line('a', 0, "## Times"),
            line('a', 0, "| run | ms |"),
            line('a', 0, "|---|---|"),
            line('c', 3 * day_s, "| one | 1.5 |"),
            line('b', 2 * day_s, "| two | 2.5 |"),
            line('a', 0, ""),
            line('a', 0, "| command | does |"),
            line('a', 0, "| `cairn` | everything |"),
            line('a', 0, "text"),
            line('d', 20_000 * day_s, "| three | 7 |"),
        ];
        let found = tables("docs/x.md", &blame.concat());
        assert_eq!(found.len(), 2, "{found:?}");
        assert_eq!((found[0].heading.as_str(), found[0].rows), ("Times", 2));
        assert_eq!((found[0].commit.as_str(), found[0].day.as_str()), (&*"b".repeat(40), "1970-01-03"));
        assert_eq!((found[1].rows, found[1].day.as_str()), (1, "2024-10-04"));
        assert!(table(&found).contains("| docs/x.md | Times | 2 | bbbbbbb | 1970-01-03 | 0 |"));
    }
}
