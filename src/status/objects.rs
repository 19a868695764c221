//! Virtual objects that a user moves, turns and scales.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Status of the objects.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ObjectsStatus {
    /// Number of changes requested.
    pub requested: u64,
    /// Number of the change that the newest picture shows.
    pub shown: u64,
    /// The objects, at their requested places.
    pub list: Vec<ObjectPlace>,
}

/// Where an object is, relative to its place in the scene's files.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ObjectPlace {
    /// Name.
    pub name: String,
    /// Displacement, world, metres.
    pub offset_m: [f64; 3],
    /// Turn about the vertical, degrees.
    pub turn_deg: f64,
    /// Scale.
    pub scale: f64,
}

/// The body of `POST /objects`: what is at a place in the picture, or a change of one object; omitted
/// values of the change stay.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectRequest {
    /// Place in the picture, shares of its width and height from the top left.
    pub at: Option<[f64; 2]>,
    /// Index of the object to change; without it the request only asks what is at `at`.
    pub object: Option<usize>,
    /// Point of the real scene, world, metres, which `at` drags to the real surface there.
    pub grabbed_m: Option<[f64; 3]>,
    /// The object's displacement, world, metres; with `grabbed_m`, where the drag began.
    pub offset_m: Option<[f64; 3]>,
    /// Turn about the vertical, degrees.
    pub turn_deg: Option<f64>,
    /// Scale.
    pub scale: Option<f64>,
}

/// The answer to `POST /objects`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ObjectAnswer {
    /// Index of the virtual object at the place, or of the changed object.
    pub object: Option<usize>,
    /// Point of the real scene at the place, world, metres.
    pub real_m: Option<[f64; 3]>,
    /// All objects.
    pub objects: ObjectsStatus,
}

/// Why a request was refused; nothing changes.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ObjectRefusal {
    /// The body is malformed.
    #[error("objects: {reason}; send a JSON object such as {{\"at\": [0.5, 0.5]}}")]
    Malformed {
        /// The parser's message.
        reason: String,
    },
    /// A value is invalid.
    #[error("{field}: {reason}")]
    Invalid {
        /// The field.
        field: &'static str,
        /// What is wrong, what is expected.
        reason: String,
    },
    /// The objects cannot be changed now.
    #[error("objects: {reason}")]
    Unavailable {
        /// The reason.
        reason: String,
    },
}

impl ObjectRequest {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// The body is malformed or a number is not finite.
    pub fn from_json(body: &[u8]) -> Result<Self, ObjectRefusal> {
        let request: Self =
            serde_json::from_slice(body).map_err(|error| ObjectRefusal::Malformed {
                reason: error.to_string(),
            })?;
        if request.at.is_none() && request.object.is_none() {
            let reason = "neither `at` nor `object` is given".to_owned();
            return Err(ObjectRefusal::Malformed { reason });
        }
        match request
            .at
            .filter(|at| at.iter().any(|x| !(0.0..=1.0).contains(x)))
        {
            Some(_) => Err(ObjectRefusal::Invalid {
                field: "at",
                reason: "expected two numbers from 0 to 1".to_owned(),
            }),
            None => Ok(request),
        }
    }
}

/// Changes the objects of a rig.
pub trait ObjectControl: Send + Sync {
    /// Answers what is at a place, or changes an object.
    ///
    /// # Errors
    /// The request cannot be met; nothing changes.
    fn carry_out(&self, request: &ObjectRequest) -> Result<ObjectAnswer, ObjectRefusal>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_requests_and_refuses_places_outside_the_picture() {
        let read = |body: &str| ObjectRequest::from_json(body.as_bytes());
        let request = read(r#"{"object": 1, "turn_deg": 30}"#).unwrap();
        assert_eq!((request.object, request.turn_deg), (Some(1), Some(30.0)));
        let text = |body: &str| read(body).unwrap_err().to_string();
        assert_eq!(
            text(r#"{"at": [0.5, 1.2]}"#),
            "at: expected two numbers from 0 to 1"
        );
        assert!(text("{}").contains("neither `at` nor `object`"));
        assert!(text(r#"{"object": 0, "rotate": 1}"#).contains("unknown field `rotate`"));
    }
}
