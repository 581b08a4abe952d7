//! Figures in the pages of `docs/`: each table stands between two comments with its name, and is written there by the
//! command that measures it, together with the build and the machine.

use crate::MeasureError;
use crate::build::measured_on;

/// The page with this text between `<!-- figures: NAME -->` and `<!-- end of figures -->`, and under it where and with
/// which build it was measured.
///
/// # Errors
/// When the comments are not on the page.
pub fn with_figures(page: &str, name: &str, figures: &str) -> Result<String, MeasureError> {
    let (begin, end) = (format!("<!-- figures: {name} -->"), "<!-- end of figures -->");
    let (before, rest) = page.split_once(&begin).ok_or_else(|| format!("the page has no comment {begin}"))?;
    let (_, after) =
        rest.split_once(end).ok_or_else(|| format!("the page has no comment {end} after {begin}"))?;
    Ok(format!(
        "{before}{begin}\n{}\n\nMeasured on two cores: {}.\n{end}{after}",
        figures.trim_end(),
        measured_on()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_named_figures_are_replaced() {
        let page = "# Page\n<!-- figures: a -->\n1\n<!-- end of figures -->\ntext\n<!-- figures: b -->\n2\n<!-- end of figures -->\nend\n";
        let new = with_figures(page, "b", "| 3 |\n").unwrap();
        assert!(new.contains("\n1\n<!-- end of figures -->\ntext\n"), "{new}");
        assert!(new.contains("<!-- figures: b -->\n| 3 |\n\nMeasured on two cores: "), "{new}");
        assert!(!new.contains("\n2\n") && new.ends_with("\n<!-- end of figures -->\nend\n"), "{new}");
        assert!(with_figures(page, "c", "").unwrap_err().to_string().contains("figures: c"));
        assert!(
            with_figures("<!-- figures: b -->", "b", "").unwrap_err().to_string().contains("end of figures")
        );
    }
}
