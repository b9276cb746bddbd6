//! Where a fleet is, as people name it on the command line.

use std::path::PathBuf;

use clap::Args;

use super::outcome::{Exit, Failure};
use crate::config::{FleetSettings, PasswordSource, Station};
use crate::fleet::{Address, FleetError};
use crate::printable::on_one_line;

/// Where a fleet is.
#[derive(Debug, Args)]
pub(super) struct Place {
    /// The address of the database, such as `postgresql://laser1@db.shop.local/isomark`, or the settings of a station that
    /// belongs to the fleet.
    #[arg(value_name = "URL|STATION.TOML")]
    pub(super) fleet: String,
    /// Reads the password for the database from the first line of this file. Default: from the environment variable
    /// ISOMARK_FLEET_PASSWORD, if it is set.
    #[arg(long, value_name = "FILE")]
    pub(super) password_file: Option<PathBuf>,
    /// Checks the server with the certificates (PEM) of the authorities in this file. Default: those that the system trusts.
    #[arg(long, value_name = "FILE")]
    pub(super) certificate: Option<PathBuf>,
}

/// The name of a line, as `lines` under `[fleet]` may have it.
pub(super) fn parse_line(text: &str) -> Result<String, String> {
    if FleetSettings::is_name(text) { Ok(text.into()) } else { Err(FleetSettings::name_remedy()) }
}

impl From<FleetError> for Failure {
    fn from(error: FleetError) -> Self {
        let exit = match error {
            FleetError::Url(_)
            | FleetError::Password(_)
            | FleetError::Certificate(_)
            | FleetError::UnknownStation { .. }
            | FleetError::UnknownFit { .. }
            | FleetError::ListForGroup { .. } => Exit::Usage,
            _ => Exit::Environment,
        };
        Self::new(exit, error.reason())
    }
}

impl Place {
    /// The station that is named in place of a URL.
    pub(super) fn station(&self) -> Result<Option<Station>, Failure> {
        // Also a URL of another kind of database is no file.
        match FleetSettings::is_url(&self.fleet) || self.fleet.contains("://") {
            true => Ok(None),
            false => Ok(Some(Station::load(self.fleet.as_ref())?)),
        }
    }

    pub(super) fn address(&self) -> Result<Address, Failure> {
        self.address_and_station().map(|(address, _)| address)
    }

    /// The address, and the name of the station if its settings are given.
    pub(super) fn address_and_station(&self) -> Result<(Address, Option<String>), Failure> {
        let given = self.password_file.clone().map(PasswordSource::File);
        let Some(station) = self.station()? else {
            let variable = FleetSettings::VARIABLE;
            let usual = std::env::var_os(variable).map(|_| PasswordSource::Variable(variable.into()));
            return Ok((Address::new(&self.fleet, given.or(usual), self.certificate.clone())?, None));
        };
        let Some(mut settings) = station.fleet else {
            let what = format!("The station of {} belongs to no fleet.", on_one_line(&self.fleet));
            return Err(Failure::usage(what, "Give `url` under [fleet] in its settings, or the URL here."));
        };
        settings.password = given.or(settings.password);
        settings.certificate = self.certificate.clone().or(settings.certificate);
        Ok((Address::of(&settings)?, Some(settings.name)))
    }
}
