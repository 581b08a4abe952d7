//! The flags as parameters of ROS: `ros2 param list`, `get`, `describe` and `dump` show them. Files of maps and routes can be set while
//! the node runs; all others are read at the start.

use crate::faults::Faults;
use cairn::sensor::SkipKind;
use clap::{Arg, ArgAction, ArgMatches, Command};
use futures::StreamExt;
use futures::stream::{LocalBoxStream, SelectAll};
use ros2_client::dds::Server;
use ros2_client::parameters::raw::{ParameterDescriptor, SetParametersResult};
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest,
    GetParameterTypesResponse, GetParametersRequest, GetParametersResponse, ListParametersRequest,
    ListParametersResponse, ListParametersResult, SetParametersAtomicallyResponse, SetParametersRequest,
    SetParametersResponse,
};
use ros2_client::{Message, Parameter, ParameterValue};
use std::any::TypeId;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Parameters that count from the next call of a service on: names of files, and whether they may be empty.
const SETTABLE: [(&str, bool); 2] = [("map", true), ("route", false)];
/// Why no other parameter can be set.
const AT_THE_START: &str = "only map and route can be set: give it at the start, and start the node again";

/// A flag with its value.
#[derive(Clone, Debug, PartialEq)]
pub struct Declared {
    name: String,
    value: ParameterValue,
    about: String,
}

/// The flags of a command as parameters: a flag has underscores in its name; one that was not given and has no default is not set.
pub fn declared(command: &Command, matches: &ArgMatches) -> Vec<Declared> {
    let of = |argument: &Arg| {
        let long = argument.get_long().filter(|long| !argument.is_hide_set() && *long != "remap")?;
        let value = match argument.get_action() {
            ArgAction::SetTrue => ParameterValue::Boolean(matches.get_flag(argument.get_id().as_str())),
            ArgAction::Set | ArgAction::Append => value(argument, matches),
            // Help and version.
            _ => return None,
        };
        let about = argument.get_help().map(ToString::to_string).unwrap_or_default();
        Some(Declared { name: long.replace('-', "_"), value, about })
    };
    command.get_arguments().filter_map(of).collect()
}

fn value(argument: &Arg, matches: &ArgMatches) -> ParameterValue {
    let given = matches.get_raw(argument.get_id().as_str()).into_iter().flatten();
    let texts: Vec<String> = given.map(|text| text.to_string_lossy().into_owned()).collect();
    let kind = argument.get_value_parser().type_id();
    let numbers: Vec<f64> = texts.iter().filter_map(|text| text.parse().ok()).collect();
    match (&texts[..], &numbers[..]) {
        ([], _) => ParameterValue::NotSet,
        ([text], _) if kind == TypeId::of::<u16>() => {
            text.parse().map_or(ParameterValue::NotSet, ParameterValue::Integer)
        }
        ([_], [number]) if kind == TypeId::of::<f64>() => ParameterValue::Double(*number),
        (_, numbers) if kind == TypeId::of::<f64>() => ParameterValue::DoubleArray(numbers.to_vec()),
        _ => ParameterValue::String(texts.join(" ")),
    }
}

/// The parameters of a node; clones refer to the same.
#[derive(Clone, Debug, Default)]
pub struct Parameters(Arc<Mutex<Vec<Declared>>>);

impl Parameters {
    /// As they are at the start.
    pub fn new(declared: Vec<Declared>) -> Self {
        Self(Arc::new(Mutex::new(declared)))
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Declared>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The file that a parameter names; `None` where it names none.
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        match self.of(name) {
            ParameterValue::String(path) if !path.is_empty() => Some(path.into()),
            _ => None,
        }
    }

    fn of(&self, name: &str) -> ParameterValue {
        self.lock().iter().find(|p| p.name == name).map_or(ParameterValue::NotSet, |p| p.value.clone())
    }

    /// Why a parameter cannot have a value.
    fn refuses(&self, name: &str, value: &ParameterValue) -> Result<(), String> {
        if !self.lock().iter().any(|p| p.name == name) {
            return Err(format!("there is no parameter {name}"));
        }
        let Some((_, may_be_empty)) = SETTABLE.iter().find(|(settable, _)| *settable == name) else {
            return Err(AT_THE_START.into());
        };
        match value {
            ParameterValue::String(path) if *may_be_empty || !path.is_empty() => Ok(()),
            _ => Err(format!("{name} is the name of a file")),
        }
    }

    /// Sets parameters, each by itself; why not, for each.
    fn set(&self, request: SetParametersRequest) -> SetParametersResponse {
        let one = |parameter: Parameter| {
            let refused = self.refuses(&parameter.name, &parameter.value);
            if refused.is_ok() {
                let mut all = self.lock();
                all.iter_mut()
                    .filter(|p| p.name == parameter.name)
                    .for_each(|p| p.value = parameter.value.clone());
            }
            result(refused)
        };
        SetParametersResponse { results: request.parameter.into_iter().map(|raw| one(raw.into())).collect() }
    }

    /// Sets all of them or none.
    fn set_atomically(&self, request: SetParametersRequest) -> SetParametersAtomicallyResponse {
        let parsed = request.parameter.iter().cloned().map(Parameter::from);
        let refused = parsed.map(|p| self.refuses(&p.name, &p.value)).find(Result::is_err);
        if refused.is_none() {
            self.set(request);
        }
        SetParametersAtomicallyResponse { result: result(refused.unwrap_or(Ok(()))) }
    }

    fn kind(&self, name: &str) -> u8 {
        ros2_client::parameters::raw::ParameterValue::from(self.of(name)).ptype
    }

    fn get(&self, request: GetParametersRequest) -> GetParametersResponse {
        GetParametersResponse { values: request.names.iter().map(|name| self.of(name).into()).collect() }
    }

    fn kinds(&self, request: GetParameterTypesRequest) -> GetParameterTypesResponse {
        GetParameterTypesResponse { values: request.names.iter().map(|name| self.kind(name)).collect() }
    }

    /// No name has a dot, so that the depth does not matter, and there are no prefixes.
    fn list(&self, request: ListParametersRequest) -> ListParametersResponse {
        let is_meant = |name: &&String| request.prefixes.is_empty() || request.prefixes.contains(name);
        let names = self.lock().iter().map(|p| &p.name).filter(is_meant).cloned().collect();
        ListParametersResponse { result: ListParametersResult { names, prefixes: Vec::new() } }
    }

    fn describe(&self, request: DescribeParametersRequest) -> DescribeParametersResponse {
        let one = |name: String| ParameterDescriptor {
            r#type: self.kind(&name),
            description: self
                .lock()
                .iter()
                .find(|p| p.name == name)
                .map_or(String::new(), |p| p.about.clone()),
            read_only: !SETTABLE.iter().any(|(settable, _)| *settable == name),
            name,
            additional_constraints: String::new(),
            dynamic_typing: false,
            floating_point_range: Vec::new(),
            integer_range: Vec::new(),
        };
        DescribeParametersResponse { values: request.names.into_iter().map(one).collect() }
    }
}

fn result(refused: Result<(), String>) -> SetParametersResult {
    SetParametersResult { successful: refused.is_ok(), reason: refused.err().unwrap_or_default() }
}

/// The services of a node about its parameters.
pub struct ParameterServers {
    /// Values.
    pub get: Server<GetParametersRequest, GetParametersResponse>,
    /// Types.
    pub kinds: Server<GetParameterTypesRequest, GetParameterTypesResponse>,
    /// Names.
    pub list: Server<ListParametersRequest, ListParametersResponse>,
    /// Descriptions.
    pub describe: Server<DescribeParametersRequest, DescribeParametersResponse>,
    /// Sets each that can be set.
    pub set: Server<SetParametersRequest, SetParametersResponse>,
    /// Sets all or none.
    pub set_atomically: Server<SetParametersRequest, SetParametersAtomicallyResponse>,
}

impl ParameterServers {
    /// Answers from now on; ends with the program.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn serve(self, all: Parameters, faults: &Faults) -> std::io::Result<()> {
        let faults = faults.clone();
        let work = move || {
            let mut calls = SelectAll::new();
            calls.push(answered(&self.get, &faults, |request| all.get(request)));
            calls.push(answered(&self.kinds, &faults, |request| all.kinds(request)));
            calls.push(answered(&self.list, &faults, |request| all.list(request)));
            calls.push(answered(&self.describe, &faults, |request| all.describe(request)));
            calls.push(answered(&self.set, &faults, |request| all.set(request)));
            calls.push(answered(&self.set_atomically, &faults, |request| all.set_atomically(request)));
            futures::executor::block_on(async { while calls.next().await.is_some() {} });
        };
        std::thread::Builder::new().name("cairn-ros-param".into()).spawn(work).map(drop)
    }
}

fn answered<'a, Q: Message + Clone + 'static, A: Message + 'static>(
    server: &'a Server<Q, A>,
    faults: &'a Faults,
    answer: impl Fn(Q) -> A + 'a,
) -> LocalBoxStream<'a, ()> {
    let calls = server.receive_request_stream().map(move |read| {
        let sent = read
            .map_err(|e| e.to_string())
            .and_then(|(id, request)| server.send_response(id, answer(request)).map_err(|e| e.to_string()));
        if let Err(why) = sent {
            faults.count(SkipKind::Other, "a question about parameters could not be answered", &why);
        }
    });
    calls.boxed_local()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Options;

    #[test]
    fn flags_are_parameters_of_their_kind() {
        let line = "cairn-ros --camera stereo --domain 3 --ros-args -p grid_range_m:=4.5 -p no_imu:=true -r odom:=/o \
            -p base_from_camera:=[0.5,0.0,1.0,-0.5,0.5,-0.5,0.5]";
        let options = Options::parse_arguments(line.split_whitespace().map(String::from)).unwrap();
        let all = options.parameters;
        let numbers = vec![0.5, 0.0, 1.0, -0.5, 0.5, -0.5, 0.5];
        for (name, value) in [
            ("camera", ParameterValue::String("stereo".into())),
            ("domain", ParameterValue::Integer(3)),
            ("grid_range_m", ParameterValue::Double(4.5)),
            ("robot_radius_m", ParameterValue::Double(0.25)),
            ("no_imu", ParameterValue::Boolean(true)),
            ("use_sim_time", ParameterValue::Boolean(false)),
            ("base_from_camera", ParameterValue::DoubleArray(numbers)),
            ("map", ParameterValue::NotSet),
            ("speed", ParameterValue::NotSet),
        ] {
            assert_eq!(all.of(name), value, "{name}");
        }
        let list = |prefixes: &[&str]| {
            let prefixes = prefixes.iter().map(ToString::to_string).collect();
            all.list(ListParametersRequest { prefixes, depth: 0 }).result.names
        };
        assert!(list(&[]).iter().any(|name| name == "use_sim_time"));
        assert!(!list(&[]).iter().any(|name| ["help", "version", "remap", "for_s"].contains(&name.as_str())));
        assert_eq!((list(&["map"]), list(&["speed"])), (vec!["map".to_owned()], Vec::new()));
        let described = all.describe(DescribeParametersRequest { names: vec!["robot_radius_m".into()] });
        assert!(described.values[0].read_only && described.values[0].description.contains("Radius"));
        assert_eq!((described.values[0].r#type, all.kind("domain"), all.kind("map")), (3, 2, 0));
    }

    #[test]
    fn files_can_be_set_and_nothing_else() {
        let words = ["cairn-ros", "--camera", "stereo", "--map", "home.map"];
        let all = Options::parse_arguments(words.map(String::from)).unwrap().parameters;
        let text = |text: &str| ParameterValue::String(text.into());
        let request = |pairs: &[(&str, ParameterValue)]| {
            let of = |(name, value): &(&str, ParameterValue)| Parameter {
                name: (*name).into(),
                value: value.clone(),
            };
            SetParametersRequest { parameter: pairs.iter().map(of).map(Into::into).collect() }
        };
        let mixed = [("map", text("other.map")), ("grid_range_m", ParameterValue::Double(3.0))];
        let together = all.set_atomically(request(&mixed)).result;
        assert!(!together.successful && together.reason.contains("only map and route"), "{together:?}");
        assert_eq!(all.file("map"), Some("home.map".into()), "all or none");
        let each = all.set(request(&mixed)).results;
        assert_eq!([each[0].successful, each[1].successful], [true, false]);
        assert_eq!(all.file("map"), Some("other.map".into()));
        let wrong = [
            ("map", ParameterValue::Integer(3)),
            ("route", text("")),
            ("route", ParameterValue::NotSet),
            ("speed", text("a")),
        ];
        assert!(all.set(request(&wrong)).results.iter().all(|r| !r.successful && !r.reason.is_empty()));
        assert!(all.set_atomically(request(&[("map", text("")), ("route", text("r"))])).result.successful);
        assert_eq!((all.file("map"), all.file("route")), (None, Some("r".into())));
        let described = all.describe(DescribeParametersRequest { names: vec!["map".into()] });
        assert!(!described.values[0].read_only);
    }
}
