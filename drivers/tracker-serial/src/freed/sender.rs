//! Sends poses as D1 datagrams to virtual-production tools.

use super::axes::Axes;
use super::message::{Lens, Message};
use penumbra_interface::RigidTransform;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// Sends the pose of a camera as FreeD D1 over UDP, one message a datagram.
#[derive(Debug)]
pub struct FreedSender {
    socket: UdpSocket,
    camera: u8,
    axes: Axes,
}

impl FreedSender {
    /// Creates a sender to `receiver`, as camera number `camera`. A receiver that does not exist
    /// yet is not an error.
    ///
    /// # Errors
    /// The operating system provides no socket or no route to the receiver.
    pub fn new(receiver: SocketAddr, camera: u8) -> io::Result<Self> {
        // From loopback to loopback, otherwise from any interface.
        let local = match receiver {
            SocketAddr::V4(to) if to.ip().is_loopback() => (Ipv4Addr::LOCALHOST, 0).into(),
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
        };
        let socket = UdpSocket::bind(local)?;
        socket.connect(receiver)?;
        // The rendering thread may call `send`, which must not wait for a full queue.
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            camera,
            axes: Axes::default(),
        })
    }

    /// The same sender with another order or other signs of the six numbers.
    #[must_use]
    pub fn with_axes(mut self, axes: Axes) -> Self {
        self.axes = axes;
        self
    }

    /// Sends the pose `world_from_camera`, where the camera's axes are right, forward and up:
    /// see [`optical_to_studio`].
    ///
    /// # Errors
    /// The operating system cannot send. A missing receiver and a full queue are not errors: only
    /// this message is lost.
    pub fn send(&self, world_from_camera: RigidTransform, lens: Lens) -> io::Result<()> {
        let message = Message::from_pose(self.camera, world_from_camera, self.axes, lens);
        match self.socket.send(&message.encode()) {
            Err(error) if !is_lost(&error) => Err(error),
            _ => Ok(()),
        }
    }
}

fn is_lost(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::ConnectionRefused | io::ErrorKind::WouldBlock
    )
}

/// `world_from_studio_camera` (axes right, forward, up) from `world_from_camera` (OpenCV's
/// optical frame: right, down, forward).
#[must_use]
pub fn optical_to_studio(world_from_camera: RigidTransform) -> RigidTransform {
    // A quarter turn about x takes forward (y) to the optical z, and up (z) to the optical −y.
    let optical_from_studio = glam::DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    RigidTransform::new(
        world_from_camera.rotation * optical_from_studio,
        world_from_camera.translation,
    )
}
