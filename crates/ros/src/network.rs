//! The node on the network: what it subscribes to, what it publishes, its services.
//!
//! Sensors are read with best effort, so that drivers of both kinds match and nothing is sent twice; results are reliable,
//! so that subscribers of both kinds match. A subscriber that does not keep up never holds the node: what it misses is
//! counted.

use crate::discovery::Discovery;
use crate::faults::{Faults, Severity};
use crate::messages::{
    CameraInfo, Clock, CompressedImage, DiagnosticArray, Image, Imu, MarkerArray, OccupancyGrid, Odometry,
    Path, PointCloud2, PoseStamped, PoseWithCovarianceStamped, TFMessage, Text, TriggerRequest,
    TriggerResponse,
};
use crate::options::{Options, Rmw, Topics, transport};
use crate::parameters::{ParameterServers, Parameters};
use crate::peers::Announcer;
use crate::pictures::Picture;
use crate::service::Service;
use crate::setup::Role;
use cairn::sensor::SkipKind;
use futures::stream::{LocalBoxStream, SelectAll, StreamExt};
use ros2_client::dds::rustdds::{
    DomainParticipantBuilder, DomainParticipantStatusEvent, RTPSEntity, StatusEvented,
};
use ros2_client::dds::{Context, Node, Publisher, RosoutRaw, Server, ServiceMapping, Subscription};
use ros2_client::qos::{Durability, History, QosProfile, Reliability, WhenFull};
use ros2_client::{MessageTypeName, Name, NodeName, NodeOptions, RmwRequestId, ServiceTypeName};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, TrySendError};

/// Messages that may wait between the network and the node.
pub const MOST_WAITING: usize = 256;
/// Samples of a sensor that may wait in the reader.
const SENSOR_DEPTH: usize = 16;

/// Why the node is not on the network.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// The domain cannot be joined.
    #[error("the network cannot be used: {0}")]
    Domain(Cause),
    /// A name of a node, topic or service that ROS does not allow, or that the network refuses.
    #[error("{name}: {why}")]
    Name {
        /// As it was given, after renaming.
        name: String,
        /// Why.
        why: Cause,
    },
    /// No thread can be started.
    #[error("no thread can be started: {0}")]
    Thread(#[from] std::io::Error),
    /// An answer cannot be sent.
    #[error(transparent)]
    Answer(Cause),
}

/// What DDS says.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// For an error about a name.
fn about<E: Into<Cause>>(name: &str) -> impl Fn(E) -> NetworkError {
    let name = name.to_owned();
    move |why| NetworkError::Name { name: name.clone(), why: why.into() }
}

/// Something that came in.
#[derive(Debug)]
pub enum Incoming {
    /// A picture.
    Picture(Role, Picture),
    /// A calibration.
    Info(Role, CameraInfo),
    /// A reading.
    Imu(Imu),
    /// Transforms that stay.
    Static(TFMessage),
    /// The time of a simulator or of a bag that is played.
    Clock(Clock),
    /// The robot by its wheels.
    Wheels(Box<Odometry>),
    /// Where the robot is to go.
    Goal(PoseStamped),
    /// Where the robot is said to be.
    InitialPose(PoseWithCovarianceStamped),
    /// A service was called.
    ServiceCall(Service, RmwRequestId),
    /// A message that could not be read.
    Unreadable(String, String),
}

type TriggerServer = Server<TriggerRequest, TriggerResponse>;

/// The node.
pub struct Network {
    /// Poses in the odometry frame, with the velocity.
    pub odometry: Output<Odometry>,
    /// Poses in the map.
    pub pose: Output<PoseWithCovarianceStamped>,
    /// The key frames of the map, in order of time.
    pub path: Output<Path>,
    /// The route that is recorded or followed.
    pub route: Output<Path>,
    /// The path to the goal.
    pub plan: Output<Path>,
    /// Key frames, their edges and the goal, for a viewer.
    pub markers: Output<MarkerArray>,
    /// The landmarks of the map.
    pub points: Output<PointCloud2>,
    /// The occupancy grid.
    pub grid: Output<OccupancyGrid>,
    /// Transforms.
    pub tf: Output<TFMessage>,
    /// Pictures with their features.
    pub features: Output<Image>,
    /// What the node is doing.
    pub diagnostics: Output<DiagnosticArray>,
    /// What the guide says.
    pub said: Output<Text>,
    servers: Vec<(Service, Arc<TriggerServer>)>,
    parameters: Option<ParameterServers>,
    inputs: Option<Vec<Input>>,
    node: Node,
    context: Context,
}

enum Input {
    Image(String, Role, Subscription<Image>),
    Compressed(String, Role, Subscription<CompressedImage>),
    Info(String, Role, Subscription<CameraInfo>),
    Imu(String, Subscription<Imu>),
    Wheels(String, Subscription<Odometry>),
    Static(String, Subscription<TFMessage>),
    Clock(String, Subscription<Clock>),
    Goal(String, Subscription<PoseStamped>),
    InitialPose(String, Subscription<PoseWithCovarianceStamped>),
}

/// A publisher with its name.
pub struct Output<M: Serialize> {
    name: String,
    publisher: Publisher<M>,
    faults: Faults,
}

impl<M: Serialize> Output<M> {
    /// Publishes; a subscriber that does not keep up is counted.
    pub fn publish(&self, message: M) {
        if let Err(e) = self.publisher.publish(message) {
            let why = e.to_string();
            self.faults.count(SkipKind::Other, &format!("{}: could not be published", self.name), &why);
        }
    }

    /// Its absolute name.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Network {
    /// Joins the domain, with the topics to read.
    ///
    /// # Errors
    /// A name that ROS does not allow; a network that cannot be used.
    pub fn join(options: &Options, topics: &Topics, faults: &Faults) -> Result<Self, NetworkError> {
        let discovery = Discovery::of_environment();
        discovery.notes.iter().for_each(|note| faults.say(Severity::Warn, note));
        let mut participant = DomainParticipantBuilder::new(options.domain_id());
        if let Some(only) = discovery.only {
            participant = participant.with_only_networks([only]);
        }
        let participant = participant.build().map_err(|e| NetworkError::Domain(e.into()))?;
        if !discovery.peers.is_empty() {
            let prefix = participant.guid().prefix.as_ref().to_vec();
            let started = Announcer::new(options.domain_id(), prefix, &discovery.peers);
            match started.and_then(Announcer::start) {
                Ok(()) => {}
                Err(why) => faults.say(Severity::Warn, &format!("ROS_STATIC_PEERS is not used: {why}")),
            }
        }
        let context = Context::from_domain_participant(participant);
        let context = context.map_err(|e| NetworkError::Domain(e.into()))?;
        let name = NodeName::new(&options.namespace, &options.name);
        let name = name.map_err(about(&format!("{} in {}", options.name, options.namespace)))?;
        // Those of the library would speak the form of fastrtps only.
        let with = NodeOptions::new().enable_rosout(true).start_parameter_services(false);
        let mut node = context.new_node(name, with).map_err(|e| NetworkError::Domain(e.into()))?;
        let logger = node.logging_handle();
        faults.also_to(Box::new(move |severity, line| {
            let level = match severity {
                Severity::Info => ros2_client::ros2::LogLevel::Info,
                Severity::Warn => ros2_client::ros2::LogLevel::Warn,
                Severity::Error => ros2_client::ros2::LogLevel::Error,
            };
            let now = ros2_client::builtin_interfaces::Time::now();
            logger.rosout_raw(now, level, logger.base_name(), line, "", "", 0);
        }));
        let mut make = Maker { node: &mut node, options, faults };
        let inputs = make.inputs(topics)?;
        let latched = results(1).durability(Durability::TransientLocal);
        let diagnostics = make.output("/diagnostics", ("diagnostic_msgs", "DiagnosticArray"), results(10))?;
        Ok(Self {
            odometry: make.output("odom", ("nav_msgs", "Odometry"), results(10))?,
            pose: make.output("pose", ("geometry_msgs", "PoseWithCovarianceStamped"), results(10))?,
            path: make.output("path", ("nav_msgs", "Path"), results(1))?,
            route: make.output("route", ("nav_msgs", "Path"), latched.clone())?,
            plan: make.output("~/plan", ("nav_msgs", "Path"), results(1))?,
            markers: make.output("markers", ("visualization_msgs", "MarkerArray"), latched.clone())?,
            points: make.output("points", ("sensor_msgs", "PointCloud2"), results(1))?,
            grid: make.output("map", ("nav_msgs", "OccupancyGrid"), latched)?,
            tf: make.output("/tf", ("tf2_msgs", "TFMessage"), results(100))?,
            features: make.output("~/features", ("sensor_msgs", "Image"), results(1))?,
            said: make.output("~/said", ("std_msgs", "String"), results(10))?,
            servers: make.servers()?,
            parameters: Some(make.parameters()?),
            diagnostics,
            inputs: Some(inputs),
            node,
            context,
        })
    }

    /// Starts to read: messages go to `to`, and are dropped and counted where nobody takes them. Once only.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn listen(&mut self, to: SyncSender<Incoming>, faults: &Faults) -> Result<(), NetworkError> {
        let inputs = self.inputs.take().unwrap_or_default();
        let (servers, faults) = (self.servers.clone(), faults.clone());
        let read = move || {
            let mut all = SelectAll::new();
            inputs.iter().for_each(|input| all.push(input.stream()));
            servers.iter().for_each(|(service, server)| all.push(calls(*service, server)));
            futures::executor::block_on(async {
                while let Some(incoming) = all.next().await {
                    match to.try_send(incoming) {
                        Ok(()) => {}
                        Err(TrySendError::Full(_)) => {
                            faults.count(
                                SkipKind::Other,
                                "messages came faster than they could be taken",
                                "",
                            );
                        }
                        Err(TrySendError::Disconnected(_)) => return,
                    }
                }
            });
        };
        let thread = std::thread::Builder::new().name("cairn-ros-in".into());
        thread.spawn(read).map(|_| ()).map_err(NetworkError::from)
    }

    /// Answers questions about the parameters from now on. Once only.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn answer_parameters(
        &mut self,
        parameters: &Parameters,
        faults: &Faults,
    ) -> Result<(), NetworkError> {
        let Some(servers) = self.parameters.take() else { return Ok(()) };
        servers.serve(parameters.clone(), faults).map_err(NetworkError::from)
    }

    /// Says which publishers and subscribers do not match this node because of their quality of service. Ends with the
    /// program.
    ///
    /// # Errors
    /// When no thread can be started.
    pub fn watch_matches(&self, faults: &Faults) -> Result<(), NetworkError> {
        let events = self.context.domain_participant().status_listener();
        let faults = faults.clone();
        let watch = move || {
            futures::executor::block_on(events.as_async_status_stream().for_each(|event| {
                let line = match event {
                    DomainParticipantStatusEvent::RemoteWriterQosIncompatible { .. } => {
                        "a publisher offers less than is asked for: best effort where --reliable asks for more"
                    }
                    DomainParticipantStatusEvent::RemoteReaderQosIncompatible { .. } => {
                        "a subscriber asks for more than is offered: only map, route, markers and rosout are latched"
                    }
                    _ => return futures::future::ready(()),
                };
                faults.count(SkipKind::Other, line, "");
                futures::future::ready(())
            }));
        };
        let thread = std::thread::Builder::new().name("cairn-ros-match".into());
        thread.spawn(watch).map(|_| ()).map_err(NetworkError::from)
    }

    /// Answers a call.
    ///
    /// # Errors
    /// When the answer cannot be sent.
    pub fn answer(
        &self,
        service: Service,
        id: RmwRequestId,
        success: bool,
        message: String,
    ) -> Result<(), NetworkError> {
        let Some((_, server)) = self.servers.iter().find(|(s, _)| *s == service) else { return Ok(()) };
        let answer = TriggerResponse { success, message };
        server.send_response(id, answer).map_err(|e| NetworkError::Answer(e.into()))
    }

    /// Whether somebody looks at the pictures with features.
    pub fn wants_features(&self) -> bool {
        self.node.subscription_count(self.features.name()) > 0
    }

    /// How many publishers of a topic are known.
    pub fn publishers_of(&self, topic: &str) -> usize {
        self.node.publisher_count(topic)
    }
}

/// Reliable, and never waiting for a subscriber.
fn results(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability(Reliability::Reliable { when_full: WhenFull::Fail })
        .history(History::KeepLast { depth })
}

struct Maker<'a> {
    node: &'a mut Node,
    options: &'a Options,
    faults: &'a Faults,
}

impl Maker<'_> {
    fn output<M: Serialize>(
        &mut self,
        name: &str,
        kind: (&str, &str),
        qos: QosProfile,
    ) -> Result<Output<M>, NetworkError> {
        let name = self.options.remapped(name);
        let dds_name = Name::parse(&name).map_err(about(&name))?;
        let topic = self.node.create_topic(&dds_name, MessageTypeName::new(kind.0, kind.1), &qos);
        let topic = topic.map_err(about(&name))?;
        let publisher = self.node.create_publisher(&topic, Some(qos)).map_err(about(&name))?;
        Ok(Output { name, publisher, faults: self.faults.clone() })
    }

    fn input<M: DeserializeOwned + 'static>(
        &mut self,
        name: &str,
        kind: (&str, &str),
        qos: QosProfile,
    ) -> Result<(String, Subscription<M>), NetworkError> {
        let name = self.options.remapped(name);
        let dds_name = Name::parse(&name).map_err(about(&name))?;
        let topic = self.node.create_topic(&dds_name, MessageTypeName::new(kind.0, kind.1), &qos);
        let topic = topic.map_err(about(&name))?;
        let subscription = self.node.create_subscription(&topic, Some(qos)).map_err(about(&name))?;
        Ok((name, subscription))
    }

    fn inputs(&mut self, topics: &Topics) -> Result<Vec<Input>, NetworkError> {
        let depth = |depth| QosProfile::subscription_default().history(History::KeepLast { depth });
        let mut sensor = depth(SENSOR_DEPTH);
        if self.options.reliable {
            sensor = sensor.reliability_reliable(WhenFull::Fail);
        }
        let latched = results(100).durability(Durability::TransientLocal);
        let mut inputs = Vec::new();
        let mut cameras = vec![(Role::Image, &topics.image, &topics.image_info)];
        cameras.extend(topics.right.as_ref().map(|(topic, info)| (Role::Right, topic, info)));
        cameras.extend(topics.depth.as_ref().map(|(topic, info)| (Role::Depth, topic, info)));
        for (role, topic, info) in cameras {
            if transport(topic).is_some() {
                let (name, s) = self.input(topic, ("sensor_msgs", "CompressedImage"), sensor.clone())?;
                inputs.push(Input::Compressed(name, role, s));
            } else {
                let (name, s) = self.input(topic, ("sensor_msgs", "Image"), sensor.clone())?;
                inputs.push(Input::Image(name, role, s));
            }
            if self.options.rig.is_none() {
                let (name, s) = self.input(info, ("sensor_msgs", "CameraInfo"), depth(1))?;
                inputs.push(Input::Info(name, role, s));
            }
        }
        if let Some(topic) = &topics.imu {
            let (name, s) = self.input(
                topic,
                ("sensor_msgs", "Imu"),
                sensor.clone().history(History::KeepLast { depth: 200 }),
            )?;
            inputs.push(Input::Imu(name, s));
        }
        if let Some(topic) = &self.options.wheels {
            let often = sensor.history(History::KeepLast { depth: 200 });
            let (name, s) = self.input(topic, ("nav_msgs", "Odometry"), often)?;
            inputs.push(Input::Wheels(name, s));
        }
        let (name, s) = self.input("/tf_static", ("tf2_msgs", "TFMessage"), latched)?;
        inputs.push(Input::Static(name, s));
        if self.options.plan {
            let (name, s) = self.input("~/goal_pose", ("geometry_msgs", "PoseStamped"), depth(1))?;
            inputs.push(Input::Goal(name, s));
        }
        let kind = ("geometry_msgs", "PoseWithCovarianceStamped");
        let (name, s) = self.input("initialpose", kind, depth(1))?;
        inputs.push(Input::InitialPose(name, s));
        if self.options.use_sim_time {
            let (name, s) = self.input("/clock", ("rosgraph_msgs", "Clock"), depth(1))?;
            inputs.push(Input::Clock(name, s));
        }
        Ok(inputs)
    }

    fn servers(&mut self) -> Result<Vec<(Service, Arc<TriggerServer>)>, NetworkError> {
        let mut servers = Vec::new();
        for service in Service::ALL {
            servers.push((service, Arc::new(self.server(service.name(), ("std_srvs", "Trigger"))?)));
        }
        Ok(servers)
    }

    fn parameters(&mut self) -> Result<ParameterServers, NetworkError> {
        let package = "rcl_interfaces";
        Ok(ParameterServers {
            get: self.server("~/get_parameters", (package, "GetParameters"))?,
            kinds: self.server("~/get_parameter_types", (package, "GetParameterTypes"))?,
            list: self.server("~/list_parameters", (package, "ListParameters"))?,
            describe: self.server("~/describe_parameters", (package, "DescribeParameters"))?,
            set: self.server("~/set_parameters", (package, "SetParameters"))?,
            set_atomically: self
                .server("~/set_parameters_atomically", (package, "SetParametersAtomically"))?,
        })
    }

    fn server<Q: ros2_client::Message + Clone + 'static, A: ros2_client::Message + 'static>(
        &mut self,
        name: &str,
        (package, kind): (&str, &str),
    ) -> Result<Server<Q, A>, NetworkError> {
        let form = match self.options.service_form() {
            Rmw::Fastrtps => ServiceMapping::Enhanced,
            Rmw::Cyclonedds => ServiceMapping::Cyclone,
        };
        let name = self.options.remapped(name);
        let dds_name = Name::parse(&name).map_err(about(&name))?;
        let kind = ServiceTypeName::new(package, kind);
        let server = self.node.create_server(form, &dds_name, &kind, results(10), results(10));
        server.map_err(about(&name))
    }
}

impl Input {
    fn stream(&self) -> LocalBoxStream<'_, Incoming> {
        match self {
            Self::Image(name, role, s) => messages(name, s, |m| Incoming::Picture(*role, Picture::Raw(m))),
            Self::Compressed(name, role, s) => {
                messages(name, s, |m| Incoming::Picture(*role, Picture::File(m)))
            }
            Self::Info(name, role, s) => messages(name, s, |m| Incoming::Info(*role, m)),
            Self::Imu(name, s) => messages(name, s, Incoming::Imu),
            Self::Wheels(name, s) => messages(name, s, |m| Incoming::Wheels(Box::new(m))),
            Self::Static(name, s) => messages(name, s, Incoming::Static),
            Self::Clock(name, s) => messages(name, s, Incoming::Clock),
            Self::Goal(name, s) => messages(name, s, Incoming::Goal),
            Self::InitialPose(name, s) => messages(name, s, Incoming::InitialPose),
        }
    }
}

fn messages<'a, M: DeserializeOwned + 'static>(
    name: &'a str,
    subscription: &'a Subscription<M>,
    of: impl Fn(M) -> Incoming + 'a,
) -> LocalBoxStream<'a, Incoming> {
    let incoming = subscription.async_stream().map(move |read| match read {
        Ok((message, _)) => of(message),
        Err(e) => Incoming::Unreadable(name.to_owned(), e.to_string()),
    });
    incoming.boxed_local()
}

fn calls(service: Service, server: &TriggerServer) -> LocalBoxStream<'_, Incoming> {
    let incoming = server.receive_request_stream().map(move |read| match read {
        Ok((id, _)) => Incoming::ServiceCall(service, id),
        Err(e) => Incoming::Unreadable(service.name().to_owned(), e.to_string()),
    });
    incoming.boxed_local()
}
