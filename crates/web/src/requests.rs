//! The requests of pages that cannot open a web socket, such as on an iPhone that does not trust the certificate: one
//! whose answer streams everything to the page, and one after another for what comes from it.
//!
//! `POST /requests` with the hello gives the line, a secret name of the connection. `GET /requests/LINE/down` streams
//! frames: length of the payload (32 bits, little-endian), kind (0 nothing, 1 text, 2 binary), number (32 bits), payload.
//! `POST /requests/LINE/texts/0` has texts, one on each line; `POST /requests/LINE/picture/0` one picture. Each of
//! these two kinds is numbered: a browser may send a request again, or several at once over connections of different
//! speed, and yet nothing is taken twice or in another order. The messages are those of the web socket.

use crate::connection::Connection;
use crate::hub::Hub;
use crate::line::{Line, Requests, frame};
use crate::page::{Guest, NoGuest, converse, guest};
use crate::places::Place;
use crate::token::new_token;
use crate::wire::ToPage;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Extension, Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use std::convert::Infallible;
use std::sync::Arc;

/// The largest hello, and the largest request of texts, bytes.
const LARGEST_HELLO: usize = 4096;
const LARGEST_TEXTS: usize = 64 << 10;
/// Some browsers show nothing of a stream before its first bytes are this many.
const FIRST_BYTES: usize = 2048;

/// The place of the connection that a request came on.
type ThePlace = Extension<Arc<Place>>;

/// The requests of pages without a web socket; `largest` is that of a picture.
pub(crate) fn routes(largest: usize) -> Router<Arc<Hub>> {
    let limited = |bytes: usize| DefaultBodyLimit::max(bytes);
    Router::new()
        .route("/requests", post(open).layer(limited(LARGEST_HELLO)))
        .route("/requests/{line}/down", get(down))
        .route("/requests/{line}/texts/{number}", post(texts).layer(limited(LARGEST_TEXTS)))
        .route("/requests/{line}/picture/{number}", post(picture).layer(limited(largest)))
}

/// Opens a line for a page with the right token.
async fn open(State(hub): State<Arc<Hub>>, Extension(place): ThePlace, hello: String) -> Response {
    let guest = match guest(&hello, &hub) {
        Ok(guest) => guest,
        Err(NoGuest) => return (StatusCode::FORBIDDEN, ToPage::Stranger(true).text()).into_response(),
    };
    if !place.keep() {
        return StatusCode::TOO_MANY_REQUESTS.into_response();
    }
    let Ok(name) = new_token() else { return StatusCode::INTERNAL_SERVER_ERROR.into_response() };
    let Some(end) = hub.lines.open(&name) else {
        return StatusCode::TOO_MANY_REQUESTS.into_response();
    };
    tokio::spawn(run(Closes { hub, name: name.clone() }, end, guest));
    without_cache(name)
}

async fn run(line: Closes, end: Requests, guest: Guest) {
    converse(Connection::Requests(end), guest, line.hub.clone()).await;
}

/// Closes a line when its task ends, however it ends.
struct Closes {
    hub: Arc<Hub>,
    name: String,
}

impl Drop for Closes {
    fn drop(&mut self) {
        self.hub.lines.close(&self.name);
    }
}

/// The line of this name; the connection on which it was named keeps its place.
fn line_of(hub: &Hub, place: &Place, name: &str) -> Result<Arc<Line>, StatusCode> {
    let line = hub.lines.find(name)?;
    place.keep().then_some(line).ok_or(StatusCode::TOO_MANY_REQUESTS)
}

/// Streams what goes to the page, once.
async fn down(
    State(hub): State<Arc<Hub>>,
    Extension(place): ThePlace,
    Path(name): Path<String>,
) -> Result<Response, StatusCode> {
    let frames = line_of(&hub, &place, &name)?.down().ok_or(StatusCode::CONFLICT)?;
    let first = Some(frame(0, 0, &[0; FIRST_BYTES]));
    let stream = futures_util::stream::unfold((first, frames), async |(first, mut frames)| {
        let next = match first {
            Some(first) => first,
            None => frames.recv().await?,
        };
        Some((Ok::<_, Infallible>(next), (None, frames)))
    });
    Ok(without_cache(Body::from_stream(stream)))
}

async fn texts(
    State(hub): State<Arc<Hub>>,
    Extension(place): ThePlace,
    Path((name, number)): Path<(String, u64)>,
    body: String,
) -> Result<StatusCode, StatusCode> {
    Ok(line_of(&hub, &place, &name)?.texts(number, &body))
}

async fn picture(
    State(hub): State<Arc<Hub>>,
    Extension(place): ThePlace,
    Path((name, number)): Path<(String, u64)>,
    body: Bytes,
) -> Result<StatusCode, StatusCode> {
    Ok(line_of(&hub, &place, &name)?.picture(number, body))
}

fn without_cache(body: impl IntoResponse) -> Response {
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream"),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    (headers, body).into_response()
}
