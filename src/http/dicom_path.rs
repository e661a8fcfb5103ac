//! Requests for what there is of DICOM results: the study, the series and the instance that a path names, what is accepted,
//! and the path of what is named.

use std::collections::BTreeMap;
use std::sync::Arc;

use axum::extract::{FromRequestParts, Path};
use axum::http::request::Parts;
use utoipa::IntoParams;

use super::accept::Accepted;
use super::auth::{Allowed, Read};
use super::error::ApiError;
use super::extract::StrictQuery;
use super::source::{invalid_uid, uid};
use crate::dicomweb::entries::Level;
use crate::formats::Uid;
use crate::formats::dicom_object::DicomObject;
use crate::jobs::objects::ObjectPath;
use crate::jobs::service::Jobs;

/// Where DICOMweb begins.
pub const ROOT: &str = "/dicom-web";

/// The `{study}` of a path, described.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes what ObjectPath takes")]
pub struct StudyParam {
    /// Study Instance UID
    #[param(max_length = 64, pattern = "^[0-9]+([.][0-9]+)*$")]
    study: String,
}

/// The `{series}` of a path, described.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes what ObjectPath takes")]
pub struct SeriesParam {
    /// Series Instance UID
    #[param(max_length = 64, pattern = "^[0-9]+([.][0-9]+)*$")]
    series: String,
}

/// The `{instance}` of a path, described.
#[derive(IntoParams)]
#[into_params(parameter_in = Path)]
#[expect(dead_code, reason = "describes what ObjectPath takes")]
pub struct InstanceParam {
    /// SOP Instance UID
    #[param(max_length = 64, pattern = "^[0-9]+([.][0-9]+)*$")]
    instance: String,
}

/// A request of a caller who may read.
pub struct DicomRequest {
    pub jobs: Arc<Jobs>,
    pub allowed: Allowed<Read>,
    /// What its path names; nothing where that has no identifiers.
    pub path: ObjectPath,
    /// The query, as it was sent.
    pub parameters: Vec<(String, String)>,
    pub accepted: Accepted,
}

impl FromRequestParts<Arc<Jobs>> for DicomRequest {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, jobs: &Arc<Jobs>) -> Result<Self, ApiError> {
        let allowed = Allowed::from_request_parts(parts, jobs).await?;
        let names = Path::<BTreeMap<String, String>>::from_request_parts(parts, jobs).await;
        let Ok(Path(names)) = names else { return Err(invalid_uid("path")) };
        let path = ObjectPath {
            study: named(&names, "study")?,
            series: named(&names, "series")?,
            instance: named(&names, "instance")?,
        };
        let StrictQuery(parameters) = StrictQuery::<Vec<(String, String)>>::from_request_parts(parts, jobs).await?;
        let accepted = Accepted::of(&parts.headers, &parameters);
        Ok(Self { jobs: Arc::clone(jobs), allowed, path, parameters, accepted })
    }
}

fn named(names: &BTreeMap<String, String>, name: &str) -> Result<Option<Uid>, ApiError> {
    names.get(name).map(|text| uid(&format!("path.{name}"), text)).transpose()
}

/// The path of an object, or of the study or the series that it is in.
pub fn path_of(object: &DicomObject, level: Level) -> String {
    let DicomObject { study, series, instance, .. } = object;
    match level {
        Level::Study => format!("{ROOT}/studies/{study}"),
        Level::Series => format!("{ROOT}/studies/{study}/series/{series}"),
        Level::Instance => format!("{ROOT}/studies/{study}/series/{series}/instances/{instance}"),
    }
}
