//! Access control: a page of another origin in a browser on the same machine must neither see the
//! picture nor change a setting.

use super::places::{Activity, Places, hold};
use super::scene_routes::UPLOAD_PATH;
use axum::Router;
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use penumbra_config::token::is_token;
use std::fmt;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

/// Name of the cookie that carries the token after the first visit.
const COOKIE: &str = "penumbra_token";
/// Maximum length of a body, bytes; settings are a few dozen.
const MAX_BODY: usize = 16 * 1024;
/// Timeout of a request and its answer, except for streams.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);
/// The same of an uploaded file, which may come over a slow network.
const UPLOAD_LIMIT: Duration = Duration::from_secs(120);

/// The secret that protects a server that other machines can reach.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// Returns the token if it is valid.
    pub fn new(text: String) -> Option<Self> {
        is_token(&text).then_some(Self(text))
    }

    /// Returns its text, for an address that is shown to the user.
    pub fn reveal(&self) -> &str {
        &self.0
    }

    /// Returns a new token that cannot be guessed.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes).map_err(std::io::Error::other)?;
        Ok(Self(
            bytes.iter().map(|byte| format!("{byte:02x}")).collect(),
        ))
    }

    /// Compares in constant time.
    fn is(&self, other: &str) -> bool {
        let differences = self
            .0
            .bytes()
            .zip(other.bytes())
            .fold(0, |d, (a, b)| d | (a ^ b));
        self.0.len() == other.len() && differences == 0
    }
}

/// A token never reaches a log.
impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

/// What the guard needs to know.
#[derive(Clone)]
pub struct Gate {
    token: Option<Arc<Token>>,
    /// Only the names of this machine itself are answered to, and nothing without the token.
    is_local: bool,
    cookie: Arc<str>,
    places: Places,
}

impl Gate {
    /// Creates the guard's state, with places for so many viewers.
    pub fn new(token: Option<Arc<Token>>, viewers: usize) -> Self {
        Self {
            token,
            is_local: false,
            cookie: COOKIE.into(),
            places: Places::new(viewers),
        }
    }

    /// Creates the state of a page at a port of loopback, which needs both the token and an own name.
    pub fn local(token: Token, port: u16) -> Self {
        Self {
            token: Some(Arc::new(token)),
            is_local: true,
            // A browser sends a cookie to all ports.
            cookie: format!("{COOKIE}_{port}").into(),
            places: Places::new(0),
        }
    }
}

/// Puts routes behind the guard.
pub fn guarded<S: Clone + Send + Sync + 'static>(routes: Router<S>, gate: Gate) -> Router<S> {
    routes
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(from_fn_with_state(gate, guard))
}

/// Accepts or refuses a request, and sets the headers of every answer. An accepted request takes a
/// place; the connection of a refused one is closed at once.
async fn guard(State(gate): State<Gate>, request: Request, next: Next) -> Response {
    let activity = request.extensions().get::<Arc<Activity>>();
    let busy = activity.map(Activity::begin);
    let mut response = match judge(&gate, &request) {
        Ok(()) => match gate.places.take(request.uri().path()) {
            Some(place) => hold(answered(request, next).await, (place, busy)),
            None => let_go((StatusCode::SERVICE_UNAVAILABLE, CROWDED).into_response()),
        },
        Err(answer) => let_go(*answer),
    };
    for (name, value) in SECURITY_HEADERS {
        // A page that needs other rights brings its own.
        let entry = response.headers_mut().entry(name);
        entry.or_insert(HeaderValue::from_static(value));
    }
    response
}

/// Closes the connection after the answer.
fn let_go(mut response: Response) -> Response {
    let close = HeaderValue::from_static("close");
    response.headers_mut().insert(header::CONNECTION, close);
    response
}

async fn answered(request: Request, next: Next) -> Response {
    let limit = match request.uri().path() {
        UPLOAD_PATH => UPLOAD_LIMIT,
        _ => ANSWER_LIMIT,
    };
    tokio::time::timeout(limit, next.run(request))
        .await
        .unwrap_or_else(|_| (StatusCode::REQUEST_TIMEOUT, "too slow\n").into_response())
}

const SECURITY_HEADERS: [(HeaderName, &str); 6] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; \
         connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
];

/// Checks that host and origin are stated once, then the host, then the origin, then the token.
fn judge(gate: &Gate, request: &Request) -> Result<(), Box<Response>> {
    let headers = request.headers();
    let is_repeated = |name| headers.get_all(name).iter().nth(1).is_some();
    if is_repeated(header::HOST) || is_repeated(header::ORIGIN) {
        return refuse(StatusCode::BAD_REQUEST, REPEATED);
    }
    let host = text(headers, &header::HOST).unwrap_or_default();
    if (gate.is_local || gate.token.is_none()) && !is_own_name(host) {
        let text = if gate.is_local {
            LOCAL_HOST_REFUSED
        } else {
            HOST_REFUSED
        };
        return refuse(StatusCode::MISDIRECTED_REQUEST, text);
    }
    if !is_own_page(request.method(), headers, host) {
        return refuse(StatusCode::FORBIDDEN, ORIGIN_REFUSED);
    }
    match &gate.token {
        Some(token) if gate.is_local || request.uri().path() != "/healthz" => {
            admit(token, &gate.cookie, request)
        }
        _ => Ok(()),
    }
}

const CROWDED: &str = "too many requests at a time; try again\n";
const REPEATED: &str = "refused: Host and Origin may be stated once only\n";
const HOST_REFUSED: &str = "this server answers to localhost and 127.0.0.1 only; \
    to reach it by another name, start it with a token\n";
const LOCAL_HOST_REFUSED: &str = "this page answers to localhost and 127.0.0.1 only\n";
const ORIGIN_REFUSED: &str = "refused: the request comes from another page\n";
const TOKEN_REFUSED: &str = "a token is needed: open /?token=…, or send \
    the header Authorization: Bearer …\n";

fn refuse(status: StatusCode, text: &'static str) -> Result<(), Box<Response>> {
    Err(Box::new((status, text).into_response()))
}

/// Whether the name resolves to this machine regardless of DNS. Any other name could be pointed at
/// 127.0.0.1 by the requesting page ("DNS rebinding"). The port is ignored: it differs behind a
/// tunnel.
fn is_own_name(host: &str) -> bool {
    let name = host.rsplit_once(':').map_or(host, |(name, port)| {
        let is_port = port.bytes().all(|b| b.is_ascii_digit());
        if is_port { name } else { host }
    });
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || bare.parse().is_ok_and(|ip: IpAddr| ip.is_loopback())
}

/// Checks the origin that browsers state; other programs state none and are accepted.
fn is_own_page(method: &Method, headers: &HeaderMap, host: &str) -> bool {
    let origin = text(headers, &header::ORIGIN);
    let same_origin = origin.is_none_or(|origin| {
        let authority = origin.split_once("://").map(|(_, authority)| authority);
        authority.is_some_and(|a| a.eq_ignore_ascii_case(host))
    });
    let site = text(headers, &HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
    let mode = text(headers, &HeaderName::from_static("sec-fetch-mode"));
    let follows_link = method == Method::GET && mode == Some("navigate");
    same_origin && (matches!(site, "same-origin" | "none") || follows_link)
}

fn admit(token: &Token, cookie: &str, request: &Request) -> Result<(), Box<Response>> {
    let headers = request.headers();
    let bearer = text(headers, &header::AUTHORIZATION).and_then(|a| a.strip_prefix("Bearer "));
    if bearer.is_some_and(|b| token.is(b.trim())) || cookies(headers, cookie).any(|c| token.is(c)) {
        return Ok(());
    }
    if query_token(request.uri()).is_some_and(|t| token.is(t)) {
        return Err(Box::new(set_cookie(token, cookie, request)));
    }
    refuse(StatusCode::UNAUTHORIZED, TOKEN_REFUSED)
}

fn cookies<'a>(headers: &'a HeaderMap, cookie: &'a str) -> impl Iterator<Item = &'a str> {
    let lines = headers.get_all(header::COOKIE).into_iter();
    lines
        .filter_map(|line| line.to_str().ok())
        .flat_map(|line| line.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter(move |(name, _)| *name == cookie)
        .map(|(_, value)| value)
}

fn query_token(uri: &Uri) -> Option<&str> {
    let pairs = uri.query().unwrap_or_default().split('&');
    pairs
        .filter_map(|p| p.split_once('='))
        .find_map(|(key, value)| (key == "token").then_some(value))
}

/// Moves the token from the address into a cookie, so that it is neither in the history nor in a
/// bookmark.
fn set_cookie(token: &Token, cookie: &str, request: &Request) -> Response {
    let cookie = format!("{cookie}={}; Path=/; HttpOnly; SameSite=Strict", token.0);
    let path = request.uri().path();
    // A path of two slashes would be read as another server's name.
    let target = format!("/{}", path.trim_start_matches('/'));
    let headers = [(header::SET_COOKIE, cookie), (header::LOCATION, target)];
    (StatusCode::SEE_OTHER, headers).into_response()
}

fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    headers.get(name).map(|v| v.to_str().unwrap_or("?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_only_loopback_host_names() {
        for own in [
            "localhost",
            "LOCALHOST:8780",
            "127.0.0.1:1",
            "127.3.2.1",
            "[::1]:8780",
            "[::1]",
        ] {
            assert!(is_own_name(own), "{own}");
        }
        for other in [
            "",
            "evil.example",
            "localhost.evil.example:80",
            "10.0.0.5:8780",
            "127.0.0.1.nip.io",
            "[::2]:80",
        ] {
            assert!(!is_own_name(other), "{other}");
        }
    }

    #[test]
    fn tokens_have_a_minimum_length_and_need_no_quoting() {
        let token = |t: &str| Token::new(t.to_owned());
        assert!(token("abcdEFGH0123-._~").is_some());
        assert!(token("short").is_none());
        assert!(token("with a space in it").is_none());
        assert!(token("with;semicolon;;").is_none());
        assert!(token(&"x".repeat(257)).is_none());
        assert_eq!(
            format!("{:?}", token("abcdEFGH0123-._~").unwrap()),
            "Token(…)"
        );
    }

    #[test]
    fn random_tokens_are_valid_and_differ() {
        let [a, b] = [0, 1].map(|_| Token::random().unwrap());
        assert!(is_token(&a.0) && a.0.len() == 32 && a != b);
    }

    #[test]
    fn token_matches_only_exactly() {
        let token = Token::new("abcdefghijkl".to_owned()).unwrap();
        assert!(token.is("abcdefghijkl"));
        for wrong in ["", "abcdefghijk", "abcdefghijkm", "abcdefghijklm"] {
            assert!(!token.is(wrong), "{wrong}");
        }
    }
}
