//! The socket and its limits.

use super::app::{App, StreamLimits};
use super::descriptors;
use super::files::files;
use super::guard::{Gate, Token, guarded};
use super::places::Activity;
use super::routes;
use super::shared::{SharedStatus, View};
use super::stall::StallGuard;
use axum::Router;
use axum::http::Request;
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::task::{AbortHandle, JoinSet};

/// Default address: loopback only.
pub const DEFAULT_LISTEN: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 8780);

/// Maximum number of connections besides those of viewers; a browser holds up to six. More than
/// there are places for requests, so that one of them is idle.
const MAX_CONNECTIONS: usize = 240;
/// File descriptors that the program has open besides connections, generously.
const OTHER_DESCRIPTORS: usize = 256;
/// Timeout of a request's header and of an idle connection.
const HEADER_LIMIT: Duration = Duration::from_secs(15);
/// Buffer per connection and direction, bytes: about one picture.
const BUFFER_BYTES: usize = 64 * 1024;
/// The system's buffer of what is sent on a connection, bytes. By default Linux lets it grow to
/// 4 MB for each viewer that does not read, and to pictures that are seconds old for a slow one.
const SEND_BUFFER_BYTES: usize = 192 * 1024;

/// Answer of a page to names that are none of its files.
const NO_FILE: &str = "there is no such file; the page is at /\n";

/// The server could not be set up.
#[derive(Debug, Error)]
pub enum StatusError {
    /// The port is in use.
    #[error(
        "port {port} on {address} is in use; choose another with --listen {address}:PORT (0 = any free port), or stop the program that uses it"
    )]
    PortInUse {
        /// Address as given, in brackets if IPv6.
        address: String,
        /// Port as given.
        port: u16,
    },
    /// Other machines could reach the server without a token.
    #[error(
        "{listen}: other machines can reach this address, so a token is needed; set one (--token), or listen on 127.0.0.1"
    )]
    TokenNeeded {
        /// Address as given.
        listen: SocketAddr,
    },
    /// The token is too short or has characters that need quoting.
    #[error("token: choose 12 to 256 letters, digits or -._~")]
    BadToken,
    /// Another error of the system.
    #[error("{listen}: cannot listen ({reason}); choose another address with --listen")]
    Listen {
        /// Address as given.
        listen: SocketAddr,
        /// The system's message.
        reason: io::Error,
    },
    /// The stream's encoder could not be set up.
    #[error("stream: {0}")]
    Encoder(#[from] crate::stream::EncodeError),
}

/// A server of another page than the dashboard, for a command that asks its user something: at a free port of
/// loopback, behind a random token, with the guard, the limits and the files of the status server.
pub struct PageServer {
    listener: TcpListener,
    local_addr: SocketAddr,
    address: String,
    router: Router,
}

impl PageServer {
    /// Binds a free port for a page's `routes`. `/dashboard/{file}` is added to them.
    ///
    /// # Errors
    /// No port can be bound, or the system gives no random numbers.
    pub fn bind(routes: Router) -> Result<Self, StatusError> {
        let listen = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let (listener, local_addr) = take_port(listen)?;
        let token = Token::random().map_err(|reason| StatusError::Listen { listen, reason })?;
        let address = format!("http://{local_addr}/?token={}", token.reveal());
        let gate = Gate::local(token, local_addr.port());
        Ok(Self {
            listener,
            local_addr,
            address,
            router: guarded(routes.merge(files(NO_FILE)), gate),
        })
    }

    /// Returns the address of the page, with its token.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Serves until the future is dropped.
    ///
    /// # Errors
    /// The listener cannot be registered with the runtime.
    pub async fn serve(self) -> Result<(), StatusError> {
        let bounds = Bounds {
            connections: MAX_CONNECTIONS,
            stall: StreamLimits::default().stall,
        };
        let listener = registered(self.listener, self.local_addr)?;
        accept(listener, self.router, bounds).await;
        Ok(())
    }
}

/// The status server, bound to its port and not yet serving.
pub struct StatusServer {
    listener: TcpListener,
    local_addr: SocketAddr,
    service: StatusService,
}

/// The status server without a port: it answers requests on any stream.
#[derive(Clone)]
pub struct StatusService {
    app: App,
    router: Router,
    bounds: Bounds,
}

impl StatusService {
    /// Creates the service; with a `token`, requests must carry it.
    ///
    /// # Errors
    /// The token is invalid, or the encoder cannot be set up.
    pub fn new(token: Option<String>, shared: Arc<SharedStatus>) -> Result<Self, StatusError> {
        Self::with_limits(token, shared, StreamLimits::default())
    }

    fn with_limits(
        token: Option<String>,
        shared: Arc<SharedStatus>,
        limits: StreamLimits,
    ) -> Result<Self, StatusError> {
        let token = token.map(|text| Token::new(text).ok_or(StatusError::BadToken));
        let app = App::new(shared, limits)?;
        let router = routes::router(app.clone(), token.transpose()?.map(Arc::new));
        let bounds = Bounds {
            connections: MAX_CONNECTIONS + limits.viewers,
            stall: limits.stall,
        };
        Ok(Self {
            app,
            router,
            bounds,
        })
    }

    /// Answers the requests of one connection until it ends.
    pub async fn converse<S>(&self, stream: S)
    where
        S: AsyncRead + AsyncWrite + Unpin,
    {
        let service = Service::new(self.router.clone(), Activity::new());
        converse(stream, self.bounds.stall, service).await;
    }
}

impl StatusServer {
    /// Binds the port, so that a port in use is reported before anything else is started.
    ///
    /// # Errors
    /// The port cannot be bound, or other machines can reach `listen` and there is no valid token.
    pub fn bind(
        listen: SocketAddr,
        token: Option<String>,
        shared: Arc<SharedStatus>,
    ) -> Result<Self, StatusError> {
        Self::bind_with(listen, token, shared, StreamLimits::default())
    }

    /// As [`Self::bind`], with other limits of the streams.
    ///
    /// # Errors
    /// As [`Self::bind`].
    pub fn bind_with(
        listen: SocketAddr,
        token: Option<String>,
        shared: Arc<SharedStatus>,
        limits: StreamLimits,
    ) -> Result<Self, StatusError> {
        if token.is_none() && !listen.ip().is_loopback() {
            return Err(StatusError::TokenNeeded { listen });
        }
        let service = StatusService::with_limits(token, shared, limits)?;
        let (listener, local_addr) = take_port(listen)?;
        descriptors::allow(service.bounds.connections + OTHER_DESCRIPTORS);
        Ok(Self {
            listener,
            local_addr,
            service,
        })
    }

    /// Returns the bound address; with port 0 the port that the system chose.
    #[must_use]
    pub const fn local_addr(&self) -> SocketAddr {
        self.local_addr
    }

    /// Serves until `shutdown`, then closes every connection.
    ///
    /// # Errors
    /// The listener cannot be registered with the runtime.
    pub async fn serve(self, shutdown: impl Future<Output = ()>) -> Result<(), StatusError> {
        let listener = registered(self.listener, self.local_addr)?;
        tokio::select! {
            () = shutdown => {}
            () = accept(listener, self.service.router, self.service.bounds) => {}
            () = self.service.app.stream_pictures(View::Composite) => {}
            () = self.service.app.stream_pictures(View::Pair) => {}
        }
        Ok(())
    }
}

/// Registers a listener with the runtime.
fn registered(
    listener: TcpListener,
    listen: SocketAddr,
) -> Result<tokio::net::TcpListener, StatusError> {
    let failed = |reason| StatusError::Listen { listen, reason };
    tokio::net::TcpListener::from_std(listener).map_err(failed)
}

fn take_port(listen: SocketAddr) -> Result<(TcpListener, SocketAddr), StatusError> {
    let bound = TcpListener::bind(listen).and_then(|listener| {
        listener.set_nonblocking(true)?;
        // Connections inherit it.
        SockRef::from(&listener).set_send_buffer_size(SEND_BUFFER_BYTES)?;
        let address = listener.local_addr()?;
        Ok((listener, address))
    });
    bound.map_err(|reason| match reason.kind() {
        io::ErrorKind::AddrInUse => StatusError::PortInUse {
            address: bracketed(listen),
            port: listen.port(),
        },
        _ => StatusError::Listen { listen, reason },
    })
}

/// Formats the address for use before a port.
fn bracketed(listen: SocketAddr) -> String {
    match listen {
        SocketAddr::V4(v4) => v4.ip().to_string(),
        SocketAddr::V6(v6) => format!("[{}]", v6.ip()),
    }
}

/// What the clients may take.
#[derive(Clone, Copy)]
struct Bounds {
    /// Maximum number of connections.
    connections: usize,
    /// Timeout of a client that does not read.
    stall: Duration,
}

/// The open connections.
struct Connections {
    bounds: Bounds,
    tasks: JoinSet<()>,
    open: Vec<(Arc<Activity>, AbortHandle)>,
}

impl Connections {
    fn new(bounds: Bounds) -> Self {
        Self {
            bounds,
            tasks: JoinSet::new(),
            open: Vec::new(),
        }
    }

    /// Makes room for one more: closes the connection that has been idle for longest.
    fn make_room(&mut self) -> bool {
        while self.tasks.try_join_next().is_some() {}
        self.open.retain(|(_, task)| !task.is_finished());
        if self.open.len() < self.bounds.connections {
            return true;
        }
        let idle = self.open.iter().enumerate();
        let idle = idle.filter_map(|(i, (activity, _))| Some((activity.idle_since()?, i)));
        let Some((_, longest)) = idle.min() else {
            return false;
        };
        self.open.swap_remove(longest).1.abort();
        true
    }

    fn add(&mut self, socket: TcpStream, router: Router) {
        let activity = Activity::new();
        // Otherwise a small response may wait for the acknowledgement of the previous one.
        let _ = socket.set_nodelay(true);
        let service = Service::new(router, Arc::clone(&activity));
        let stall = self.bounds.stall;
        let task = self.tasks.spawn(converse(socket, stall, service));
        self.open.push((activity, task));
    }
}

/// Accepts connections until the future is dropped, which closes all of them.
async fn accept(listener: tokio::net::TcpListener, router: Router, bounds: Bounds) {
    let most = bounds.connections;
    let mut connections = Connections::new(bounds);
    loop {
        match listener.accept().await {
            Ok((socket, _)) if connections.make_room() => {
                connections.add(socket, router.clone());
            }
            // Closing at once leaves the server able to answer those it has.
            Ok(_) => tracing::debug!("more than {most} busy connections; one refused"),
            // Out of descriptors, most likely: trying again at once would spin.
            Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
        }
    }
}

/// The routes, for one connection.
struct Service {
    router: TowerToHyperService<Router>,
    activity: Arc<Activity>,
}

impl Service {
    fn new(router: Router, activity: Arc<Activity>) -> Self {
        Self {
            router: TowerToHyperService::new(router),
            activity,
        }
    }
}

impl hyper::service::Service<Request<Incoming>> for Service {
    type Response = Response;
    type Error = Infallible;
    type Future =
        <TowerToHyperService<Router> as hyper::service::Service<Request<Incoming>>>::Future;

    fn call(&self, mut request: Request<Incoming>) -> Self::Future {
        request.extensions_mut().insert(Arc::clone(&self.activity));
        self.router.call(request)
    }
}

async fn converse<S>(stream: S, stall: Duration, service: Service)
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let io = TokioIo::new(StallGuard::new(stream, stall));
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_LIMIT)
        .max_buf_size(BUFFER_BYTES)
        .serve_connection(io, service);
    // A client that disconnects or does not use HTTP is not logged.
    if let Err(error) = connection.await {
        tracing::debug!(%error, "connection ended");
    }
}
