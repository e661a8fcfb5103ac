//! What operators and newcomers ask for.

use std::sync::{Arc, LazyLock};

use axum::Json;
use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::response::IntoResponse;
use serde::Serialize;

use super::error::{ApiError, PROBLEM_JSON};
use crate::jobs::queue::Jobs;
use crate::problem::Problem;

const INDEX: &str = "\
medialrep: a label mask (NIfTI) in, its medial sheet, surfaces and thickness vectors out.

  POST   /v1/jobs                      the mask as the body, or a form with mask and params
  GET    /v1/jobs                      all jobs, newest first
  GET    /v1/jobs/{id}                 one job: state, progress, results
  GET    /v1/jobs/{id}/results/{name}  model.glb, thickness.json, thickness.csv, points.csv
  POST   /v1/jobs/{id}/cancel          stop it
  DELETE /v1/jobs/{id}                 erase it, mask and results
  GET    /livez, /readyz               whether the service runs, and whether it works
  GET    /openapi.yaml                 all of this in full

  curl --data-binary @mask.nii.gz http://HOST/v1/jobs
";

/// How the service is.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Health {
    /// `alive` or `ready`.
    status: &'static str,
    /// Version of the program.
    version: &'static str,
}

/// What is where.
#[utoipa::path(get, path = "/", tag = "operation", responses((status = 200, body = String, content_type = "text/plain", description = "A short text")))]
pub async fn index() -> &'static str {
    INDEX
}

/// Whether the process runs.
#[utoipa::path(get, path = "/livez", tag = "operation", responses((status = 200, body = Health, description = "It runs")))]
pub async fn livez() -> Json<Health> {
    Json(Health { status: "alive", version: env!("CARGO_PKG_VERSION") })
}

/// Whether the service can do its work: the database and the data directory take a write, and
/// workers are alive.
#[utoipa::path(
    get, path = "/readyz", tag = "operation",
    responses(
        (status = 200, body = Health, description = "It can"),
        (status = 503, body = Problem, content_type = PROBLEM_JSON, description = "`not_ready`")
    )
)]
pub async fn readyz(State(jobs): State<Arc<Jobs>>) -> Result<Json<Health>, ApiError> {
    let broken = jobs.what_is_broken().await;
    if broken.is_empty() {
        return Ok(Json(Health { status: "ready", version: env!("CARGO_PKG_VERSION") }));
    }
    tracing::warn!(?broken, "not ready");
    Err(Problem::new(503, "not_ready", broken.join(", ")).into())
}

/// This description.
#[utoipa::path(
    get, path = "/openapi.yaml", tag = "operation",
    responses((status = 200, body = String, content_type = "application/yaml", description = "OpenAPI 3.1"))
)]
pub async fn openapi() -> impl IntoResponse {
    static YAML: LazyLock<String> = LazyLock::new(super::openapi_yaml);
    ([(CONTENT_TYPE, "application/yaml")], YAML.as_str())
}
