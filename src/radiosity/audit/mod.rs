//! What is known about a solution's errors and energy: error bars, their audit by independent paths, and the energy ledger.

mod energy_ledger;
mod error_bars;
mod estimate;
mod points_error;
mod solved;
mod uncertainty;

pub use energy_ledger::{Ledger, Powers};
pub use error_bars::{AuditSize, ErrorBarAudit};
pub use estimate::{ErrorEstimate, ErrorSource};
pub use points_error::PointsError;
pub use solved::{FinalLight, Solved};
pub use uncertainty::{error_estimate, link_uncertainty};
