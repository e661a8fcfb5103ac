//! Access tokens.

use async_trait::async_trait;
use jiff::Timestamp;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::{SqliteStore, rows};
use crate::jobs::store::{StoreError, TokenStore};
use crate::jobs::token::{Scope, StoredToken};

#[async_trait]
impl TokenStore for SqliteStore {
    async fn insert_token(&self, token: &StoredToken) -> Result<(), StoreError> {
        let scopes: Vec<_> = token.scopes.iter().map(|scope| scope.name()).collect();
        sqlx::query(
            "INSERT INTO tokens (id, secret_sha256, tenant, scopes, created_at_ms, expires_at_ms, deliver_to)
             VALUES ($1, $2, $3, $4, $5, $6, $7)",
        )
        .bind(&token.id)
        .bind(&token.secret_sha256)
        .bind(&token.tenant)
        .bind(scopes.join(" "))
        .bind(token.created_at.as_millisecond())
        .bind(token.expires_at.map(Timestamp::as_millisecond))
        .bind(&token.deliver_to)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    async fn get_token(&self, id: &str) -> Result<Option<StoredToken>, StoreError> {
        let row = sqlx::query("SELECT * FROM tokens WHERE id = $1").bind(id).fetch_optional(&self.reader).await?;
        row.as_ref().map(token).transpose()
    }

    async fn list_tokens(&self) -> Result<Vec<StoredToken>, StoreError> {
        let rows = sqlx::query("SELECT * FROM tokens ORDER BY created_at_ms, id").fetch_all(&self.reader).await?;
        rows.iter().map(token).collect()
    }

    async fn has_tokens(&self) -> Result<bool, StoreError> {
        Ok(sqlx::query("SELECT 1 FROM tokens LIMIT 1").fetch_optional(&self.reader).await?.is_some())
    }

    async fn revoke_token(&self, id: &str, now: Timestamp) -> Result<bool, StoreError> {
        let revoked = sqlx::query("UPDATE tokens SET revoked_at_ms = $1 WHERE id = $2 AND revoked_at_ms IS NULL")
            .bind(now.as_millisecond())
            .bind(id)
            .execute(&self.writer)
            .await?;
        Ok(revoked.rows_affected() > 0)
    }
}

fn token(row: &SqliteRow) -> Result<StoredToken, StoreError> {
    let scopes: String = row.try_get("scopes")?;
    let scopes = scopes.split_whitespace().map(|name| name.parse::<Scope>().map_err(|_| rows::corrupt("scopes")));
    Ok(StoredToken {
        id: row.try_get("id")?,
        secret_sha256: row.try_get("secret_sha256")?,
        tenant: row.try_get("tenant")?,
        scopes: scopes.collect::<Result<_, _>>()?,
        created_at: rows::time(row, "created_at_ms")?.ok_or_else(|| rows::corrupt("created_at_ms"))?,
        expires_at: rows::time(row, "expires_at_ms")?,
        revoked_at: rows::time(row, "revoked_at_ms")?,
        deliver_to: row.try_get("deliver_to")?,
    })
}
