//! `cairn run --foxglove`: a client of Foxglove's protocol beside a run.

use crate::binary::{fails, folder, stderr};
use cairn_bag::{CameraInfo, Wire, WireFormat};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::{Error, Message};

const WORLD: &str = "sim:demo?duration=4&resolution=320x240&sensor=rgbd";

/// A run, and where it listens.
struct Run {
    process: Child,
    address: String,
    /// What else it says on stderr.
    said: Option<JoinHandle<Vec<String>>>,
}

impl Run {
    fn begin(source: &[&str]) -> Self {
        let arguments = [&["run", "--foxglove", "127.0.0.1:0"], source].concat();
        let mut process = Command::new(env!("CARGO_BIN_EXE_cairn"))
            .args(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let address =
            lines.find_map(|line| line.unwrap().strip_prefix("Foxglove: open ws://").map(str::to_owned));
        // It must not fill the pipe.
        let said = std::thread::spawn(move || lines.map_while(Result::ok).collect());
        Self { process, address: address.expect("it says where it listens"), said: Some(said) }
    }

    /// Waits for its end: what it said.
    fn end(&mut self) -> String {
        assert_eq!(self.process.wait().unwrap().code(), Some(0));
        self.said.take().unwrap().join().unwrap().join("\n")
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A client with what the server said first.
struct Client {
    socket: WebSocketStream<TcpStream>,
    info: Value,
    channels: BTreeMap<String, Value>,
}

impl Client {
    async fn connect(address: &str, headers: &[(&'static str, &'static str)]) -> Result<Self, Error> {
        let mut request = format!("ws://{address}").into_client_request()?;
        for (name, value) in headers {
            request.headers_mut().insert(*name, HeaderValue::from_static(value));
        }
        let stream = TcpStream::connect(address).await?;
        let (mut socket, _) = tokio_tungstenite::client_async(request, stream).await?;
        let mut json = async || -> Value {
            let message = socket.next().await.unwrap().unwrap();
            serde_json::from_str(message.to_text().unwrap()).unwrap()
        };
        let (info, advertised) = (json().await, json().await);
        let channels = advertised["channels"].as_array().unwrap().iter();
        let channels = channels.map(|c| (c["topic"].as_str().unwrap().to_owned(), c.clone())).collect();
        Ok(Self { socket, info, channels })
    }

    /// Subscribes to topics with their index as the name of the subscription.
    async fn subscribe(&mut self, topics: &[&str]) {
        let subscription =
            |(id, topic): (usize, &&str)| json!({ "id": id, "channelId": self.channels[*topic]["id"] });
        let subscriptions: Vec<Value> = topics.iter().enumerate().map(subscription).collect();
        let request = json!({ "op": "subscribe", "subscriptions": subscriptions });
        self.socket.send(Message::text(request.to_string())).await.unwrap();
    }

    /// The next message: its subscription, its time, its content; `None` where the server has closed.
    async fn next(&mut self) -> Option<(u32, i64, Vec<u8>)> {
        loop {
            let message = tokio::time::timeout(Duration::from_secs(20), self.socket.next()).await.unwrap()?;
            match message.unwrap() {
                Message::Binary(bytes) if bytes[0] == 1 => {
                    let stamp = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                    return Some((
                        u32::from_le_bytes(bytes[1..5].try_into().unwrap()),
                        stamp as i64,
                        bytes[13..].to_vec(),
                    ));
                }
                Message::Binary(bytes) => assert_eq!((bytes[0], bytes.len()), (2, 9), "the time"),
                Message::Close(_) => return None,
                other => panic!("{other:?}"),
            }
        }
    }
}

const PROTOCOL: (&str, &str) = ("Sec-WebSocket-Protocol", "foxglove.sdk.v1, foxglove.websocket.v1");

fn block_on<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(future)
}

/// Frame, and translation and quaternion, of a pose or a transform with its two frames.
fn pose(message: &[u8], frames: usize) -> (Vec<String>, [f64; 7]) {
    let mut wire = Wire::new(WireFormat::Cdr, message).unwrap();
    wire.time().unwrap();
    ((0..frames).map(|_| wire.string().unwrap()).collect(), wire.f64s().unwrap())
}

#[test]
fn a_client_sees_the_poses_of_the_run_and_a_late_one_what_stands() {
    let folder = folder("foxglove");
    let live = folder.join("live.tum");
    let mut run = Run::begin(&[WORLD, "--realtime", "--live-trajectory", live.to_str().unwrap()]);
    let address = run.address.clone();
    block_on(async {
        let mut early = Client::connect(&address, &[PROTOCOL]).await.unwrap();
        assert_eq!(
            (&early.info["op"], &early.info["capabilities"]),
            (&json!("serverInfo"), &json!(["time"]))
        );
        let channel = &early.channels["/pose"];
        assert_eq!(channel["schemaName"], "foxglove_msgs/msg/PoseInFrame");
        assert_eq!((&channel["encoding"], &channel["schemaEncoding"]), (&json!("cdr"), &json!("ros2msg")));
        assert!(channel["schema"].as_str().unwrap().starts_with("builtin_interfaces/Time timestamp\n"));
        // Foxglove's parser of ROS 2 definitions refuses the capital K of ROS 1.
        let schemas = early.channels.values().map(|c| c["schema"].as_str().unwrap());
        let fields = schemas.flat_map(str::lines).filter(|l| !l.contains('=') && !l.starts_with("MSG:"));
        for field in fields {
            let name = field.split(' ').nth(1).unwrap();
            assert!(
                name.chars().all(|c| c == '_' || c.is_ascii_lowercase() || c.is_ascii_digit()),
                "{field}"
            );
        }
        early.subscribe(&["/pose", "/path"]).await;
        let mut poses = Vec::new();
        while poses.len() < 20 {
            let (id, stamp, message) = early.next().await.unwrap();
            if id == 0 {
                poses.push((stamp, pose(&message, 1)));
            }
        }

        // The lens and the place of the camera were said once, before this one came.
        let mut late =
            Client::connect(&address, &[("Sec-WebSocket-Protocol", "foxglove.websocket.v1")]).await.unwrap();
        late.subscribe(&["/calibration", "/tf_static", "/points", "/tf"]).await;
        let mut first = BTreeMap::new();
        while first.len() < 4 {
            let (id, stamp, message) = late.next().await.unwrap();
            first.entry(id).or_insert((stamp, message));
        }
        let info = CameraInfo::of("foxglove_msgs/CameraCalibration", WireFormat::Cdr, &first[&0].1).unwrap();
        assert_eq!((info.width, info.height, info.header.frame_id.as_str()), (320, 240, "cam0"));
        assert_eq!(pose(&first[&1].1, 2).0, ["body", "cam0"]);
        assert!(first[&1].0 < poses[2].0 && first[&2].0 < poses[2].0, "not the last, but a new one");
        assert!(first[&2].1.len() > 12 * 100, "points");
        assert_eq!(pose(&first[&3].1, 2).0, ["map", "body"]);

        let mut path = None;
        while let Some((id, stamp, message)) = early.next().await {
            match id {
                0 => poses.push((stamp, pose(&message, 1))),
                _ => path = Some(message),
            }
        }
        assert!(!run.end().contains("messages were dropped"), "a client that reads loses nothing");
        let text = std::fs::read_to_string(&live).unwrap();
        let numbers = |line: &str| line.split(' ').map(|v| v.parse().unwrap()).collect::<Vec<f64>>();
        let written: BTreeMap<i64, Vec<f64>> = (text.lines().filter(|l| !l.starts_with('#')).map(numbers))
            .map(|v| ((v[0] * 1e6).round() as i64, v[1..].to_vec()))
            .collect();
        assert!(poses.len() > 25, "{} poses", poses.len());
        for (stamp, (frames, pose)) in &poses {
            let same = &written[&(stamp / 1000)];
            assert_eq!(frames, &["map"]);
            assert!(pose.iter().zip(same).all(|(a, b)| (a - b).abs() < 1e-6), "{pose:?} {same:?}");
        }
        assert_eq!(
            poses.last().map(|p| p.0 / 1000),
            written.keys().next_back().copied(),
            "the end is missing"
        );
        let path = path.expect("the path of all frames comes at the end");
        assert!(path.len() > 56 * written.len(), "{} bytes", path.len());
    });
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_client_that_does_not_read_loses_messages_and_the_run_goes_on() {
    // 20 images of 1.2 MB.
    let mut run = Run::begin(&["sim:demo?duration=4&resolution=1280x960&sensor=mono&rate=10"]);
    let client = block_on(async {
        let mut client = Client::connect(&run.address, &[PROTOCOL]).await.unwrap();
        client.subscribe(&["/image", "/features", "/events"]).await;
        client.next().await.unwrap();
        client
    });
    let said = run.end();
    assert!(said.contains("messages were dropped for clients slower than the run"), "{said}");
    drop(client);
}

#[test]
fn strangers_and_a_port_that_is_taken_are_refused() {
    let run = Run::begin(&[WORLD, "--realtime"]);
    block_on(async {
        let status =
            async |headers: &[(&'static str, &'static str)]| match Client::connect(&run.address, headers)
                .await
            {
                Err(Error::Http(response)) => response.status().as_u16(),
                other => panic!("{:?}", other.err()),
            };
        assert_eq!(status(&[]).await, 400);
        assert_eq!(status(&[PROTOCOL, ("Origin", "https://example.com")]).await, 403);
        let page = Client::connect(&run.address, &[PROTOCOL, ("Origin", "https://app.foxglove.dev")]).await;
        let mut page = page.unwrap();
        page.socket.send(Message::text("{")).await.unwrap();
        while let Message::Binary(_) = page.socket.next().await.unwrap().unwrap() {}
    });
    fails(
        &["run", WORLD, "--foxglove", &run.address],
        &["--foxglove 127.0.0.1:", "in use", "give another port"],
    );
    let wrong = crate::binary::cairn(&["run", WORLD, "--foxglove", "here"]);
    assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
}
