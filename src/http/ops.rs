//! What operators and newcomers ask for.

use std::sync::{Arc, OnceLock};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use axum::{Extension, Json};
use serde::Serialize;
use tokio::task::spawn_blocking;
use utoipa::openapi::OpenApi;

use super::auth::{Allowed, TokenProblems, TooManyRequests, Watch};
use super::error::{ApiError, PROBLEM_JSON};
use crate::jobs::service::Jobs;
use crate::problem::Problem;

/// What is where.
pub(super) const INDEX: &str = "\
medialrep: a label mask in, its medial sheet, surfaces and thickness vectors out.

  POST   /v1/jobs                      the mask as the body, or a form with mask and params
  GET    /v1/jobs                      your jobs, newest first
  GET    /v1/jobs/{id}                 one job: state, progress, results; ?wait=20 waits for its end
  GET    /v1/jobs/{id}/events          what happens to it, as server-sent events
  GET    /v1/jobs/{id}/result          the result in the media type of Accept
  GET    /v1/jobs/{id}/results/{name}  a file of its result, such as model.glb
  POST   /v1/jobs/{id}/cancel          stop it
  POST   /v1/jobs/{id}/retry           run it again
  DELETE /v1/jobs/{id}                 erase it, mask and results
  POST   /dicom-web/studies            segmentations from a PACS (STOW-RS), a job each
  POST   /dicom-web/studies/{study}    the same, of one study
  GET    /dicom-web/studies            DICOM results for a PACS to find (QIDO-RS), by study,
         /dicom-web/series             by series,
         /dicom-web/instances          or each
         /dicom-web/studies/{study}/instances
  GET    /dicom-web/studies/{study}    and to fetch (WADO-RS), with attributes as JSON:
         /dicom-web/studies/{study}/metadata
         /dicom-web/studies/{study}/series/{series}/metadata
         /dicom-web/studies/{study}/series/{series}/instances/{instance}/metadata
         /dicom-web/studies/{study}/series/{series}/instances/{instance}/bulkdata/{tag}
  GET    /v1/samples                   masks to try it on
  GET    /v1/samples/{name}            one of them, gzip NIfTI
  GET    /v1/limits                    what is taken in, how long it is kept, and the parameters
  GET    /livez, /readyz, /metrics     whether the service runs, whether it works, how well
  GET    /openapi.yaml, /docs          all of this in full, and to be tried out

  curl --data-binary @mask.nii.gz http://HOST/v1/jobs
";

/// How the service is.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Health {
    /// `alive` or `ready`.
    status: &'static str,
    /// Version of the program.
    version: &'static str,
    /// What an operator should see to although the service works.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<&'static str>,
}

impl Health {
    fn new(status: &'static str) -> Self {
        Self { status, version: env!("CARGO_PKG_VERSION"), warnings: Vec::new() }
    }
}

/// Whether the process runs.
#[utoipa::path(get, path = "/livez", tag = "operation", security(()), responses((status = 200, body = Health, description = "It runs")))]
pub async fn livez() -> Json<Health> {
    Json(Health::new("alive"))
}

/// Whether the service can do its work: the database and the data directory take a write, workers
/// are alive, and it is not about to stop.
#[utoipa::path(
    get, path = "/readyz", tag = "operation", security(()),
    responses(
        (status = 200, body = Health, description = "It can"),
        (status = 503, body = Problem, content_type = PROBLEM_JSON, description = "`not_ready`")
    )
)]
pub async fn readyz(State(jobs): State<Arc<Jobs>>) -> Result<Json<Health>, ApiError> {
    let broken = jobs.what_is_broken().await;
    if broken.is_empty() {
        let mut health = Health::new("ready");
        if jobs.is_disk_low() {
            health.warnings.push("the disk is nearly full: masks are refused, all else works");
        }
        return Ok(Json(health));
    }
    tracing::warn!(?broken, "not ready");
    Err(Problem::new(503, "not_ready", broken.join(", ")).into())
}

/// What operators alarm on, in the text format of OpenMetrics.
#[utoipa::path(
    get, path = "/metrics", tag = "operation",
    responses(
        (status = 200, body = String, content_type = "application/openmetrics-text", description = "The metrics of this process"),
        TokenProblems,
        TooManyRequests
    )
)]
pub async fn metrics(State(jobs): State<Arc<Jobs>>, _allowed: Allowed<Watch>) -> Result<impl IntoResponse, ApiError> {
    let text = jobs.metrics().render(&jobs.now().await?).map_err(|_| Problem::internal())?;
    Ok(([(CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")], text))
}

/// This description.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "operation", security(()),
    responses((status = 200, body = String, content_type = "application/yaml", description = "OpenAPI 3.1"))
)]
pub async fn openapi(Extension(description): Extension<Description>) -> Result<impl IntoResponse, ApiError> {
    // Written by whoever asks first, which takes some milliseconds.
    let yaml = spawn_blocking(move || description.yaml()).await.ok().flatten();
    Ok(([(CONTENT_TYPE, "application/yaml")], yaml.ok_or_else(Problem::internal)?))
}

/// The description of the routes.
#[derive(Clone)]
pub struct Description(Arc<(OpenApi, OnceLock<Bytes>)>);

impl Description {
    /// As a document that is written when it is asked for.
    pub fn of(document: OpenApi) -> Self {
        Self(Arc::new((document, OnceLock::new())))
    }

    /// OpenAPI 3.1 in YAML.
    fn yaml(&self) -> Option<Bytes> {
        let (document, written) = &*self.0;
        if let Some(yaml) = written.get() {
            return Some(yaml.clone());
        }
        let yaml = document.to_yaml().ok()?;
        Some(written.get_or_init(|| yaml.into()).clone())
    }
}
