//! A self-contained HTML page: headings, key figures, plots, tables, transcripts. It opens offline in any browser, in
//! light or dark mode, and is accessible to screen readers: landmarks, table headers, titled figures, no script.

use crate::svg::{Figure, escape, style};
use std::fmt::Write as _;

/// A line of a transcript.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    /// Number shown in the plan; `None` for a line that is not in the plan.
    pub number: Option<usize>,
    /// Seconds from the start.
    pub t_s: f64,
    /// The spoken words.
    pub words: String,
    /// The situation, in a few words; may be empty.
    pub note: String,
}

/// Builds a page from top to bottom. All text is escaped.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
    headings: Vec<String>,
    figures: usize,
    section_open: bool,
}

impl Page {
    /// A page with a title and an introductory sentence.
    pub fn new(title: &str, lead: &str) -> Self {
        let body =
            format!("<header><h1>{}</h1><p class=\"lead\">{}</p></header>", escape(title), escape(lead));
        Self { title: title.to_owned(), body, headings: Vec::new(), figures: 0, section_open: false }
    }

    /// Starts a section.
    pub fn heading(&mut self, text: &str) {
        self.close_section();
        let id = self.headings.len() + 1;
        self.headings.push(text.to_owned());
        let _ = write!(
            self.body,
            "<section aria-labelledby=\"section-{id}\"><h2 id=\"section-{id}\">{}</h2>",
            escape(text)
        );
        self.section_open = true;
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) {
        let _ = write!(self.body, "<p>{}</p>", escape(text));
    }

    /// Key figures: names with their values in large type.
    pub fn facts(&mut self, facts: &[(&str, &str)]) {
        self.body.push_str("<dl class=\"facts\">");
        for (name, value) in facts {
            let _ = write!(self.body, "<div><dt>{}</dt><dd>{}</dd></div>", escape(name), escape(value));
        }
        self.body.push_str("</dl>");
    }

    /// A figure with its caption.
    pub fn figure(&mut self, figure: &Figure, caption: &str) {
        self.figures += 1;
        let id = format!("figure-{}", self.figures);
        let _ = write!(
            self.body,
            "<figure><div class=\"scroll\" role=\"group\" aria-label=\"{}\" tabindex=\"0\">{}</div><figcaption>{}</figcaption></figure>",
            escape(&figure.title),
            figure.inline(&id),
            escape(caption)
        );
    }

    /// A table; the first cell of a row is its header. Numeric columns are right-aligned.
    pub fn table(&mut self, caption: &str, header: &[&str], rows: &[Vec<String>]) {
        let _ = write!(
            self.body,
            "<div class=\"scroll\" role=\"group\" aria-label=\"{0}\" tabindex=\"0\"><table><caption>{0}</caption><thead><tr>",
            escape(caption)
        );
        let numeric: Vec<bool> = (0..header.len()).map(|c| is_numeric_column(rows, c)).collect();
        for (column, name) in header.iter().enumerate() {
            let class = number_class(&numeric, column);
            let _ = write!(self.body, "<th scope=\"col\"{class}>{}</th>", escape(name));
        }
        self.body.push_str("</tr></thead><tbody>");
        for row in rows {
            self.body.push_str("<tr>");
            for (column, cell) in row.iter().enumerate() {
                let class = number_class(&numeric, column);
                let _ = match column {
                    0 => write!(self.body, "<th scope=\"row\"{class}>{}</th>", escape(cell)),
                    _ => write!(self.body, "<td{class}>{}</td>", escape(cell)),
                };
            }
            self.body.push_str("</tr>");
        }
        self.body.push_str("</tbody></table></div>");
    }

    /// A transcript of spoken messages, in order of time.
    pub fn transcript(&mut self, caption: &str, lines: &[Said]) {
        let _ = write!(
            self.body,
            "<table class=\"transcript\"><caption>{}</caption><thead><tr><th scope=\"col\">No.</th>\
             <th scope=\"col\" class=\"n\">Time</th><th scope=\"col\">Said</th><th scope=\"col\">Note</th></tr></thead><tbody>",
            escape(caption)
        );
        for line in lines {
            let number = line.number.map(|n| n.to_string()).unwrap_or_default();
            let _ = write!(
                self.body,
                "<tr><td><span class=\"no\">{number}</span></td><td class=\"n\">{}</td>\
                 <td class=\"said\">{}</td><td class=\"note\">{}</td></tr>",
                clock(line.t_s),
                escape(&line.words),
                escape(&line.note)
            );
        }
        self.body.push_str("</tbody></table>");
    }

    /// A list of links to other files, by relative address.
    pub fn links(&mut self, links: &[(String, String)]) {
        self.body.push_str("<ul>");
        for (text, address) in links {
            let _ = write!(self.body, "<li><a href=\"{}\">{}</a></li>", escape(address), escape(text));
        }
        self.body.push_str("</ul>");
    }

    /// Long text that is collapsed, such as a configuration.
    pub fn folded(&mut self, summary: &str, text: &str) {
        let _ = write!(
            self.body,
            "<details><summary>{}</summary><pre tabindex=\"0\">{}</pre></details>",
            escape(summary),
            escape(text)
        );
    }

    /// The complete HTML text.
    pub fn finish(mut self) -> String {
        self.close_section();
        let title = escape(&self.title);
        let mut contents = String::new();
        if self.headings.len() > 2 {
            contents.push_str("<nav aria-label=\"Contents\"><ul>");
            for (i, heading) in self.headings.iter().enumerate() {
                let _ = write!(contents, "<li><a href=\"#section-{}\">{}</a></li>", i + 1, escape(heading));
            }
            contents.push_str("</ul></nav>");
        }
        let body = self.body.replacen("</header>", &format!("{contents}</header>"), 1);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <meta name=\"color-scheme\" content=\"light dark\"><title>{title}</title>\
             <style>{}{PAGE_STYLE}</style></head>\n<body><main>{body}</main></body></html>\n",
            style()
        )
    }

    fn close_section(&mut self) {
        if std::mem::take(&mut self.section_open) {
            self.body.push_str("</section>");
        }
    }
}

/// True when every cell of the column starts like a number.
fn is_numeric_column(rows: &[Vec<String>], column: usize) -> bool {
    let mut cells =
        rows.iter().filter_map(|r| r.get(column)).filter(|c| !c.is_empty() && *c != "-").peekable();
    cells.peek().is_some()
        && cells.all(|c| c.trim_start_matches(['-', '+']).starts_with(|c: char| c.is_ascii_digit()))
}

fn number_class(numeric: &[bool], column: usize) -> &'static str {
    if numeric.get(column) == Some(&true) { " class=\"n\"" } else { "" }
}

/// Minutes and seconds with one decimal.
fn clock(t_s: f64) -> String {
    if !t_s.is_finite() {
        return "-".into();
    }
    let sign = if t_s < 0.0 { "-" } else { "" };
    let tenths = (t_s.abs() * 10.0).round() as u64;
    format!("{sign}{}:{:02}.{}", tenths / 600, tenths / 10 % 60, tenths % 10)
}

const PAGE_STYLE: &str = "\
:root{--ink:#1b1f24;--muted:#57606a;--paper:#fff;--card:#f3f5f7;--rule:#d0d7de;--link:#0a5cad}\
@media (prefers-color-scheme:dark){:root{--ink:#e6edf3;--muted:#a3adb8;--paper:#14181d;--card:#1e242b;--rule:#39414b;--link:#6cb6ff}}\
*{box-sizing:border-box}\
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,sans-serif}\
main{max-width:832px;margin:0 auto;padding:24px 20px 64px}\
h1{font-size:1.9rem;line-height:1.2;margin:0 0 .3rem}h2{font-size:1.35rem;margin:2.4rem 0 .6rem;padding-top:.6rem;border-top:1px solid var(--rule)}\
h3{font-size:1.05rem;margin:1.6rem 0 .4rem}p{max-width:68ch;margin:.6rem 0}.lead{font-size:1.1rem;color:var(--muted)}\
a{color:var(--link)}nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:.3rem 1.2rem;padding:0;margin:1rem 0 0}\
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:10px;margin:1.2rem 0}\
.facts div{background:var(--card);border-radius:8px;padding:10px 14px}.facts dt{color:var(--muted);font-size:.85rem}\
.facts dd{margin:0;font-size:1.35rem;font-weight:600;font-variant-numeric:tabular-nums}\
figure{margin:1.4rem 0}figure svg{display:block;width:100%;min-width:560px;height:auto}figcaption{color:var(--muted);font-size:.9rem;margin-top:.4rem}\
.scroll{overflow-x:auto}table{border-collapse:collapse;width:100%;margin:1rem 0;font-size:.95rem}\
caption{text-align:left;color:var(--muted);font-size:.9rem;padding-bottom:.4rem}\
th,td{text-align:left;vertical-align:top;padding:6px 10px;border-bottom:1px solid var(--rule)}\
thead th{color:var(--muted);font-weight:600}tbody th{font-weight:600}.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}\
.said{font-weight:600}.note{color:var(--muted)}.no:not(:empty){display:inline-block;min-width:24px;text-align:center;border:1.5px solid;border-radius:12px;font-size:.8rem;padding:0 5px}\
details{margin:1rem 0}summary{cursor:pointer}pre{overflow-x:auto;background:var(--card);border-radius:8px;padding:12px;font-size:.85rem}\
:focus-visible{outline:2px solid var(--link);outline-offset:2px}\
@media print{main{max-width:none;padding:0}figure,table{break-inside:avoid}}";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{Labels, Series, line_chart};

    fn page() -> String {
        let mut page = Page::new("A <page>", "Lead & more");
        page.heading("One");
        page.facts(&[("ATE", "0.004 m")]);
        let labels = Labels { title: "t".into(), description: "d".into(), ..Labels::default() };
        let figure =
            line_chart(&labels, &[Series { points: vec![(0.0, 1.0), (1.0, 2.0)], ..Series::default() }], &[]);
        page.figure(&figure, "first");
        page.figure(&figure, "second");
        page.heading("Two");
        page.table(
            "Stages",
            &["stage", "p50"],
            &[vec!["extract".into(), "3.1".into()], vec!["track".into(), "-".into()]],
        );
        page.heading("Three");
        page.transcript(
            "Said",
            &[Said { number: Some(1), t_s: 61.25, words: "Turn <left>.".into(), note: String::new() }],
        );
        page.folded("Config", "a = \"<b>\"");
        page.finish()
    }

    #[test]
    fn page_has_no_external_references() {
        let html = page();
        let without_namespace = html.replace("http://www.w3.org/2000/svg", "");
        for outside in ["http:", "https:", "src=", "@import", "url(", "<script"] {
            assert!(!without_namespace.contains(outside), "{outside}");
        }
        assert!(html.contains("<title>A &lt;page&gt;</title>") && html.contains("Turn &lt;left&gt;."));
    }

    #[test]
    fn tags_are_balanced_and_ids_unique() {
        let html = page();
        let tags = [
            "html",
            "head",
            "body",
            "main",
            "header",
            "nav",
            "section",
            "h1",
            "h2",
            "figure",
            "figcaption",
            "svg",
            "title",
            "desc",
            "table",
            "caption",
            "thead",
            "tbody",
            "tr",
            "th",
            "td",
            "dl",
            "dt",
            "dd",
            "div",
            "ul",
            "li",
            "details",
            "pre",
            "p",
            "a",
            "span",
            "text",
        ];
        for tag in tags {
            let open = html.matches(&format!("<{tag}>")).count() + html.matches(&format!("<{tag} ")).count();
            let close = html.matches(&format!("</{tag}>")).count();
            assert!(open == close && open > 0, "{tag}: {open} opened, {close} closed");
        }
        let mut ids: Vec<&str> = html.split(" id=\"").skip(1).map(|s| s.split('"').next().unwrap()).collect();
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!((count, ids.len()), (7, 7));
    }

    #[test]
    fn numeric_columns_are_right_aligned_and_times_formatted() {
        let html = page();
        assert!(
            html.contains("<th scope=\"col\" class=\"n\">p50</th>")
                && html.contains("<th scope=\"col\">stage</th>")
        );
        assert!(html.contains("<th scope=\"row\">extract</th>"));
        assert_eq!(
            (clock(61.25), clock(0.04), clock(-5.0)),
            ("1:01.3".into(), "0:00.0".into(), "-0:05.0".into())
        );
    }
}
