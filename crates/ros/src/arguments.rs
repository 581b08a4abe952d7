//! What ROS puts behind `--ros-args`, in the words of the node's own flags.
//!
//! After the design of ROS 2 command line arguments (design.ros2.org, "ROS 2 Command Line Arguments") and the parameter files of rcl:
//! remaps, parameters, log levels, an enclave; a name before a colon says which node is meant.

use crate::faults::{Log, Severity};
use cairn_files::yaml::{self, Node, Value};
use clap::{ArgAction, Command};
use std::path::Path;

/// What a command line says.
#[derive(Debug, Default)]
pub(crate) struct Given {
    /// The node's own flags, without the name of the program.
    pub flags: Vec<String>,
    pub log: Log,
    /// What is not as the command line asks for, one line each.
    pub notes: Vec<String>,
}

/// The node's own flags, and what ROS says between `--ros-args` and `--`, where a parameter is a flag of `command`.
///
/// # Errors
/// An argument without its value, a parameter that is none, a parameter file that cannot be read.
pub(crate) fn read(
    arguments: impl IntoIterator<Item = String>,
    command: &Command,
) -> Result<Given, clap::Error> {
    let (mut own, mut ros) = (Vec::new(), Vec::new());
    let mut of_ros = false;
    for argument in arguments {
        match argument.as_str() {
            "--ros-args" => of_ros = true,
            "--" if of_ros => of_ros = false,
            _ if of_ros => ros.push(argument),
            _ => own.push(argument),
        }
    }
    let name = Name::of(&own, &ros);
    let mut given = Given::default();
    let mut ros = ros.into_iter();
    while let Some(argument) = ros.next() {
        let mut value = || {
            let none = || wrong(format!("{argument} wants a value behind it"));
            ros.next().ok_or_else(none)
        };
        match argument.as_str() {
            "-r" | "--remap" => {
                if let Some(remap) = name.addressed(&value()?) {
                    given.flags.extend(["--remap".into(), remap]);
                }
            }
            "-p" | "--param" => {
                if let Some(parameter) = name.addressed(&value()?) {
                    let (key, text) = parameter
                        .split_once(":=")
                        .ok_or_else(|| wrong(format!("\"{parameter}\" is not of the form NAME:=VALUE")))?;
                    let value = yaml::parse(text).map_err(|(_, why)| wrong(format!("{key}: {why}")))?;
                    let flag = flag(key, &value, command).map_err(wrong)?;
                    given.flags.extend(flag.ok_or_else(|| wrong(unknown(key)))?);
                }
            }
            "--params-file" => given.parameters(Path::new(&value()?), &name, command)?,
            "--log-level" => {
                let level = value()?;
                match level.split_once(":=") {
                    // Levels of ROS's own loggers are not those of this node.
                    Some((logger, _)) if logger.trim_start_matches('/').replace('.', "/") != name.full() => {}
                    _ => given.log.least = severity(level.rsplit(":=").next().unwrap_or_default())?,
                }
            }
            "-e" | "--enclave" => {
                let enclave = value()?;
                given.notes.push(format!("enclave {enclave}: this node does not speak DDS security"));
            }
            "--log-config-file" | "--log-file-name" => {
                given
                    .notes
                    .push(format!("{argument} {} is not used: this node writes no log file", value()?));
            }
            "--enable-stdout-logs" => given.log.to_terminal = true,
            "--disable-stdout-logs" => given.log.to_terminal = false,
            "--enable-rosout-logs" => given.log.to_rosout = true,
            "--disable-rosout-logs" => given.log.to_rosout = false,
            "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
            _ => return Err(wrong(format!("{argument}: not known behind --ros-args"))),
        }
    }
    // A flag that is given twice has its last value: that of the node's own flags.
    given.flags.extend(own);
    Ok(given)
}

impl Given {
    /// Adds the parameters that a file has for this node.
    fn parameters(&mut self, path: &Path, name: &Name, command: &Command) -> Result<(), clap::Error> {
        let about = |why: String| wrong(format!("{}: {why}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|e| about(e.to_string()))?;
        let file = yaml::parse(&text).map_err(|(line, why)| about(format!("line {line}: {why}")))?;
        let mut found = Vec::new();
        parameters_of(&file, &mut Vec::new(), name, &mut found);
        for (key, value) in found {
            match flag(key, value, command).map_err(|why| about(format!("line {}: {why}", value.line)))? {
                Some(flag) => self.flags.extend(flag),
                // One file serves many nodes.
                None => self.notes.push(format!("{}: {} It is left out.", path.display(), unknown(key))),
            }
        }
        Ok(())
    }
}

/// The node that is started: its name and those of its namespaces.
struct Name(Vec<String>);

impl Name {
    /// By flags or remaps, before anything else is read.
    fn of(own: &[String], ros: &[String]) -> Self {
        let (mut name, mut namespace) = ("cairn".to_owned(), String::new());
        let mut take = |key: &str, value: &str| match key {
            "--name" | "__node" | "__name" => value.clone_into(&mut name),
            "--namespace" | "__ns" => value.clone_into(&mut namespace),
            _ => {}
        };
        for pair in own.windows(2) {
            take(&pair[0], &pair[1]);
        }
        for text in own.iter().chain(ros) {
            if let Some((key, value)) = text.split_once(":=").or_else(|| text.split_once('=')) {
                take(key, value);
            }
        }
        Self(tokens(&namespace).chain([&*name]).map(str::to_owned).collect())
    }

    fn full(&self) -> String {
        self.0.join("/")
    }

    /// A rule without the name of the node that it is for; `None` if it is for another one.
    fn addressed(&self, rule: &str) -> Option<String> {
        // A rule that is none is refused by who reads it.
        let Some((key, value)) = rule.split_once(":=") else { return Some(rule.to_owned()) };
        match key.split_once(':') {
            Some((node, key)) => (self.0.last()? == node).then(|| format!("{key}:={value}")),
            None => Some(rule.to_owned()),
        }
    }

    /// Whether a file means this node: `*` stands for one name, `**` for any number.
    fn matches(&self, path: &[&str]) -> bool {
        fn fits(pattern: &[&str], name: &[String]) -> bool {
            match (pattern, name) {
                ([], []) => true,
                (["**", rest @ ..], _) => (0..=name.len()).any(|n| fits(rest, &name[n..])),
                ([first, rest @ ..], [own, others @ ..]) => {
                    (*first == "*" || first == own) && fits(rest, others)
                }
                _ => false,
            }
        }
        let pattern: Vec<&str> = path.iter().flat_map(|part| tokens(part)).collect();
        fits(&pattern, &self.0)
    }
}

fn tokens(name: &str) -> impl Iterator<Item = &str> {
    name.split('/').filter(|token| !token.is_empty())
}

/// The parameters that a file has for a node: mappings by names of nodes and namespaces, down to `ros__parameters`.
fn parameters_of<'a>(
    node: &'a Node,
    path: &mut Vec<&'a str>,
    name: &Name,
    found: &mut Vec<(&'a str, &'a Node)>,
) {
    let Value::Map(entries) = &node.value else { return };
    for (key, value) in entries {
        if key != "ros__parameters" {
            path.push(key);
            parameters_of(value, path, name, found);
            path.pop();
        } else if let (Value::Map(parameters), true) = (&value.value, name.matches(path)) {
            found.extend(parameters.iter().map(|(key, value)| (key.as_str(), value)));
        }
    }
}

/// The flag with this value: a parameter has the name of its flag, with underscores. `None` where no flag has the name.
fn flag(parameter: &str, value: &Node, command: &Command) -> Result<Option<Vec<String>>, String> {
    let long = parameter.replace('_', "-");
    let Some(argument) = command.get_arguments().find(|a| a.get_long() == Some(&long)) else {
        return Ok(None);
    };
    let flag = format!("--{long}");
    if matches!(argument.get_action(), ArgAction::SetTrue) {
        return match value.text() {
            Some("true" | "True") => Ok(Some(vec![flag])),
            Some("false" | "False") => Ok(Some(Vec::new())),
            _ => Err(format!("{parameter} is true or false")),
        };
    }
    let items = value.list().unwrap_or(std::slice::from_ref(value));
    let texts: Option<Vec<String>> = items.iter().map(|item| item.text().map(str::to_owned)).collect();
    // An empty text is how a launch file leaves a parameter unset.
    let texts = texts.ok_or_else(|| format!("{parameter} is a value or a list of values"))?;
    Ok(Some(if texts.iter().all(String::is_empty) { Vec::new() } else { [vec![flag], texts].concat() }))
}

/// An error of usage, which prints itself.
pub(crate) fn wrong(why: String) -> clap::Error {
    clap::Error::raw(clap::error::ErrorKind::ValueValidation, why + "\n")
}

fn unknown(parameter: &str) -> String {
    format!(
        "this node has no parameter \"{parameter}\"; parameters are named as its flags are (--help), with underscores."
    )
}

fn severity(level: &str) -> Result<Severity, clap::Error> {
    match level.to_ascii_lowercase().as_str() {
        "unset" | "debug" | "info" => Ok(Severity::Info),
        "warn" => Ok(Severity::Warn),
        "error" | "fatal" => Ok(Severity::Error),
        _ => Err(wrong(format!("\"{level}\" is no log level: debug, info, warn, error, fatal"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Arg;

    fn given(line: &str) -> Result<Given, clap::Error> {
        let values = ["image", "right", "depth", "imu", "map", "grid-range-m", "base-from-camera"];
        let switches =
            ["no-tf", "use-sim-time"].map(|name| Arg::new(name).long(name).action(ArgAction::SetTrue));
        let command = Command::new("node").args(values.map(|name| Arg::new(name).long(name))).args(switches);
        read(line.split_whitespace().map(String::from), &command)
    }

    fn flags(line: &str) -> Result<String, clap::Error> {
        Ok(given(line)?.flags.join(" "))
    }

    #[test]
    fn what_a_launch_file_gives_becomes_flags() {
        let line = "--image /a --ros-args -r __node:=eye -r __ns:=/robot -r odom:=/vo -p image:=/b -p no_tf:=true -p eye:depth:=/d \
                    -p other:imu:=/i --log-level eye:=warn -e / --disable-rosout-logs -- --right /r";
        let given = given(line).unwrap();
        assert_eq!(
            given.flags.join(" "),
            "--remap __node:=eye --remap __ns:=/robot --remap odom:=/vo --image /b --no-tf --depth /d --image /a --right /r"
        );
        assert_eq!(
            given.log,
            Log { to_rosout: false, ..Log::default() },
            "the logger of the node is robot.eye"
        );
        assert_eq!(given.notes.len(), 1, "{:?}", given.notes);
        assert_eq!(
            flags("--ros-args -p base_from_camera:=[0,0,0.5,-0.5,0.5,-0.5,0.5]").unwrap().split(' ').count(),
            8
        );
        assert_eq!(flags("--ros-args -p use_sim_time:=false -p map:=''").unwrap(), "");
        for wrong in [
            "-p",
            "-p image",
            "-p speed:=3",
            "-p no_tf:=1",
            "--log-level loud",
            "--params-file /none",
            "--camera mono",
        ] {
            assert!(flags(&format!("--ros-args {wrong}")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn levels_of_other_loggers_are_theirs() {
        let least = |line: &str| given(line).unwrap().log.least;
        assert_eq!(least("--ros-args --log-level error"), Severity::Error);
        assert_eq!(least("--ros-args --log-level rcl:=debug --log-level cairn:=WARN"), Severity::Warn);
        assert_eq!(least("--ros-args -r __ns:=/a/b --log-level a.b.cairn:=fatal"), Severity::Error);
    }

    #[test]
    fn a_parameter_file_is_read_for_the_nodes_it_names() {
        let path = std::env::temp_dir().join(format!("cairn-ros-{}.yaml", std::process::id()));
        let text = "/**:\n  ros__parameters:\n    use_sim_time: true\n    qos_overrides: {a: 1}\n\
                    other:\n  ros__parameters: {image: /wrong}\n\
                    cairn:\n  ros__parameters:\n    image: /left\n    grid_range_m: 4.5\n\
                    robot:\n  cairn:\n    ros__parameters: {imu: /imu}\n\
                    /robot/*:\n  ros__parameters: {right: /right}\n";
        std::fs::write(&path, text).unwrap();
        let file = path.display();
        let given = flags(&format!("--ros-args --params-file {file}")).unwrap();
        assert_eq!(given, "--use-sim-time --image /left --grid-range-m 4.5");
        let given = flags(&format!("--ros-args --params-file {file} -r __ns:=/robot")).unwrap();
        assert_eq!(
            given, "--use-sim-time --imu /imu --right /right --remap __ns:=/robot",
            "a name alone is that of a node in no namespace"
        );
        std::fs::write(&path, "cairn:\n  ros__parameters: {no_tf: 3}\n").unwrap();
        let error = flags(&format!("--ros-args --params-file {file}")).unwrap_err().to_string();
        assert!(error.contains("line 2: no_tf is true or false"), "{error}");
        std::fs::remove_file(path).unwrap();
    }
}
