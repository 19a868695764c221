//! Requests to the status server, over a stream in memory. Time is simulated, so that no timeout is
//! waited for.

use bytes::Bytes;
use penumbra_status::calibration::{
    Calibration, CalibrationControl, CalibrationRefusal, CalibrationRequest,
};
use penumbra_status::objects::{ObjectAnswer, ObjectControl, ObjectRefusal, ObjectRequest};
use penumbra_status::recording::{Recording, RecordingControl, RecordingRefusal, RecordingRequest};
use penumbra_status::scene_files::{
    SaveRequest, SceneAnswer, SceneControl, SceneFileEntry, SceneFileKind, SceneFolder,
    SceneRefusal, SceneRequest,
};
use penumbra_status::{Settings, SharedStatus, StatusService};
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex, split};
use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;

const TOKEN: &str = "a-token-for-tests";
/// Capacity of the stream, bytes.
const STREAM_BYTES: usize = 1 << 16;
/// Maximum size of an uploaded file, bytes.
const MAX_UPLOAD_BYTES: u64 = 2000;
/// Longer than every limit of the server, so that only endless answers reach it.
const PATIENCE: Duration = Duration::from_secs(300);

static SERVER: LazyLock<Server> = LazyLock::new(Server::start);

/// Sends the input as the bytes of one connection, to a server with or without a token by the first
/// byte: each answer is one of HTTP, and none reports an error of the server itself.
pub fn http(data: &[u8]) {
    let Some((choice, requests)) = data.split_first() else {
        return;
    };
    let answer = SERVER.answer(choice % 2 == 1, requests);
    let head = &answer[..answer.len().min(32)];
    assert!(
        answer.is_empty() || answer.starts_with(b"HTTP/1."),
        "{head:?}"
    );
    assert!(!head.starts_with(b"HTTP/1.1 500"), "internal error");
}

struct Server {
    runtime: Runtime,
    open: StatusService,
    closed: StatusService,
}

impl Server {
    fn start() -> Self {
        let shared = SharedStatus::new(Settings::default());
        shared.set_recorder(Arc::new(Anything));
        shared.set_calibrator(Arc::new(Anything));
        shared.set_object_control(Arc::new(Anything));
        shared.set_scene_control(Arc::new(Anything));
        let mut builder = Builder::new_current_thread();
        let runtime = builder.enable_time().start_paused(true).build();
        let service = |token| StatusService::new(token, Arc::clone(&shared));
        match (runtime, service(None), service(Some(TOKEN.to_owned()))) {
            (Ok(runtime), Ok(open), Ok(closed)) => Self {
                runtime,
                open,
                closed,
            },
            _ => panic!("the server cannot be set up"),
        }
    }

    fn answer(&self, with_token: bool, requests: &[u8]) -> Vec<u8> {
        let service = if with_token { &self.closed } else { &self.open };
        self.runtime.block_on(async {
            let (client, server) = duplex(STREAM_BYTES);
            let (mut from_server, mut to_server) = split(client);
            let mut answer = Vec::new();
            let conversation = async {
                tokio::join!(service.converse(server), async {
                    // The server may have closed the connection after the first request.
                    let _ = to_server.write_all(requests).await;
                    let _ = (&mut from_server)
                        .take(1 << 20)
                        .read_to_end(&mut answer)
                        .await;
                })
            };
            let _ = timeout(PATIENCE, conversation).await;
            answer
        })
    }
}

/// Accepts every request that can be read.
struct Anything;

impl RecordingControl for Anything {
    fn carry_out(&self, _: &RecordingRequest) -> Result<Recording, RecordingRefusal> {
        Ok(Recording::default())
    }
}

impl ObjectControl for Anything {
    fn carry_out(&self, _: &ObjectRequest) -> Result<ObjectAnswer, ObjectRefusal> {
        Ok(ObjectAnswer::default())
    }
}

impl CalibrationControl for Anything {
    fn view(&self) -> Calibration {
        Calibration::default()
    }

    fn start(&self, _: &CalibrationRequest) -> Result<(), CalibrationRefusal> {
        Ok(())
    }

    fn finish(&self) -> Result<(), CalibrationRefusal> {
        Ok(())
    }

    fn abort(&self) -> Result<(), CalibrationRefusal> {
        Ok(())
    }

    fn picture(&self, _: Option<u64>) -> Option<Bytes> {
        Some(Bytes::from_static(b"\xff\xd8\xff\xd9"))
    }

    fn report(&self) -> Option<String> {
        Some("<!doctype html>".to_owned())
    }
}

impl SceneControl for Anything {
    fn list(&self) -> SceneFolder {
        SceneFolder::default()
    }

    fn max_upload_bytes(&self) -> u64 {
        MAX_UPLOAD_BYTES
    }

    fn show(&self, _: &SceneRequest) -> Result<SceneAnswer, SceneRefusal> {
        Ok(SceneAnswer::default())
    }

    fn keep(&self, name: &str, content: &[u8]) -> Result<SceneFileEntry, SceneRefusal> {
        let bytes = content.len() as u64;
        assert!(bytes <= MAX_UPLOAD_BYTES, "{bytes}");
        assert!(!name.contains(['/', '\\', '\0']), "{name}");
        Ok(SceneFileEntry {
            name: name.to_owned(),
            kind: SceneFileKind::Model,
            bytes,
        })
    }

    fn save(&self, _: &SaveRequest) -> Result<SceneAnswer, SceneRefusal> {
        Ok(SceneAnswer::default())
    }
}
