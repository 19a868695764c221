//! `usbcam serve SOCKET` plugs the cameras in and executes commands; `usbcam send SOCKET COMMAND`
//! sends one and prints the answer.

use penumbra_usbcam::bus::Bus;
use penumbra_usbcam::command::{HELP, execute};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["serve", socket] => serve(socket),
        ["send", socket, command @ ..] if !command.is_empty() => send(socket, &command.join(" ")),
        _ => Err(format!(
            "usage: usbcam serve SOCKET | usbcam send SOCKET COMMAND\n{HELP}"
        )),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => {
            eprintln!("usbcam: {text}");
            ExitCode::FAILURE
        }
    }
}

fn serve(path: &str) -> Result<(), String> {
    let mut bus = Bus::default();
    bus.reset().map_err(|error| error.to_string())?;
    let listener = UnixListener::bind(path).map_err(|error| format!("{path}: {error}"))?;
    for connection in listener.incoming() {
        if let Err(error) = connection.and_then(|stream| answer(&mut bus, stream)) {
            eprintln!("usbcam: {error}");
        }
    }
    Ok(())
}

fn answer(bus: &mut Bus, mut stream: UnixStream) -> io::Result<()> {
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line)?;
    let answer = execute(bus, line.trim()).unwrap_or_else(|error| format!("error: {error}"));
    println!("{} -> {answer}", line.trim());
    writeln!(stream, "{answer}")
}

fn send(path: &str, command: &str) -> Result<(), String> {
    let answer = exchange(path, command).map_err(|error| format!("{path}: {error}"))?;
    match answer.strip_prefix("error: ") {
        Some(error) => Err(error.trim().to_owned()),
        None => {
            print!("{answer}");
            Ok(())
        }
    }
}

fn exchange(path: &str, command: &str) -> io::Result<String> {
    let mut stream = UnixStream::connect(path)?;
    writeln!(stream, "{command}")?;
    stream.shutdown(Shutdown::Write)?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    Ok(answer)
}
