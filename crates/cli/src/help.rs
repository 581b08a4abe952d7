//! The help of `cairn` itself: commands in groups, what most need first.

use clap::Command;
use clap::builder::StyledStr;
use std::fmt::Write;

/// The groups and their commands, in order.
const GROUPS: [(&str, &[&str]); 5] = [
    ("Start here", &["demo", "run", "doctor"]),
    ("Maps and routes", &["map", "view", "route", "mesh", "plan", "fleet"]),
    ("A phone, a robot", &["serve", "page", "ros"]),
    ("Recordings, cameras, figures", &["rig", "eval", "bench", "sim", "config", "vocab"]),
    ("Solvers and filters", &["solve", "team", "ekf"]),
];

/// Commands that have no group stand here.
const REST: &str = "This program";

/// The command with its subcommands listed in groups.
pub fn grouped(command: Command) -> Command {
    let header = *command.get_styles().get_header();
    let literal = *command.get_styles().get_literal();
    let shown = |c: &&Command| !c.is_hide_set();
    let width = command.get_subcommands().filter(shown).map(|c| c.get_name().len()).max().unwrap_or(0);
    let about = |c: &Command| c.get_about().map(StyledStr::to_string).unwrap_or_default();
    let line = |c: &Command| {
        let name = c.get_name();
        format!("  {literal}{name}{literal:#}{:1$}  {2}\n", "", width - name.len(), about(c))
    };
    let mut text = String::new();
    let in_group = |name: &str| GROUPS.iter().any(|(_, names)| names.contains(&name));
    for (group, names) in GROUPS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{header}{group}:{header:#}");
        let listed =
            names.iter().filter_map(|name| command.get_subcommands().find(|c| c.get_name() == *name));
        listed.filter(shown).for_each(|c| text += &line(c));
        text.push('\n');
    }
    let _ = writeln!(text, "{header}{REST}:{header:#}");
    let rest = command.get_subcommands().filter(shown).filter(|c| !in_group(c.get_name()));
    rest.for_each(|c| text += &line(c));
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{text}\n{header}Options:{header:#}\n{{options}}{{after-help}}"
    );
    command.help_template(template).after_help("\ncairn COMMAND --help explains a command.")
}
