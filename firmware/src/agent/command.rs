//! Commands of the control center: each is executed once and acknowledged every time.

use super::{FlightAgent, flight::Mission, upload::Incomplete};
use crate::{Vec3, io::Outputs};
use skyroost_protocol::{
    message::{AckStatus, Command, FlightPhase, MissionHeader, Up},
    units::{CommandId, TimePs, m_from_mm},
};

impl FlightAgent {
    /// Executes `command` unless its number was seen before, and acknowledges it either way.
    pub(super) fn obey(&mut self, now: TimePs, id: CommandId, command: &Command, outputs: &mut Outputs) {
        let status = match self.links.last_command {
            // Numbers compare modulo 2^16, so that they may wrap.
            Some((last, status)) if (id.0.wrapping_sub(last.0) as i16) <= 0 => status,
            _ => {
                let status = self.execute(command);
                self.links.last_command = Some((id, status));
                status
            }
        };
        let ack = Up::CommandAck { command: id, status };
        self.transmitter.up(now, &ack, outputs, &mut self.counters);
    }

    fn execute(&mut self, command: &Command) -> AckStatus {
        use FlightPhase::{GoTo, Grounded, Hold, ReturnHome, Serve, Sweep, TakeOff};
        let phase = self.flight.phase();
        match command {
            Command::UploadBegin(header) => {
                if phase == Sweep {
                    return AckStatus::WrongPhase;
                }
                if self.upload.begin(header, &mut self.lanes) {
                    AckStatus::Accepted
                } else {
                    AckStatus::OutOfRange
                }
            }
            Command::UploadCommit { mission, lanes_crc } => {
                if phase == Sweep {
                    return AckStatus::WrongPhase;
                }
                match self.upload.complete(*mission, *lanes_crc, &mut self.lanes) {
                    // As it is ready already: laying lanes takes most of a step, and is not to be had twice in one.
                    Ok(header) if self.is_ready(&header) => AckStatus::Accepted,
                    Ok(header) => match Mission::new(self.config.id, &header, &mut self.lanes) {
                        Some(ready) => {
                            self.mission = Some(ready);
                            AckStatus::Accepted
                        }
                        None => AckStatus::OutOfRange,
                    },
                    Err(Incomplete::Missing(first_missing)) => AckStatus::Incomplete { first_missing },
                    Err(Incomplete::Checksum) => AckStatus::Incomplete { first_missing: 0 },
                    Err(Incomplete::Unknown) => AckStatus::WrongPhase,
                }
            }
            Command::TakeOff => {
                let (Some(mission), Some((_, nav)), Grounded) = (&self.mission, &self.nav, phase) else {
                    return AckStatus::WrongPhase;
                };
                self.flight.take_off(nav, mission);
                AckStatus::Accepted
            }
            Command::StartSweep { at } => match (&self.mission, phase) {
                (Some(_), Hold | Serve) if !self.lanes.is_empty() => {
                    self.flight.start_sweep(*at);
                    AckStatus::Accepted
                }
                _ => AckStatus::WrongPhase,
            },
            Command::Place { target } => match phase {
                Hold | Sweep | GoTo | Serve => {
                    self.flight.go_to(Vec3::from(target.0.map(m_from_mm)));
                    AckStatus::Accepted
                }
                _ => AckStatus::WrongPhase,
            },
            Command::Hold => match (phase, &self.nav) {
                // Also on the way home: where the supervisor insists, it goes on at once.
                (Hold | Sweep | GoTo | Serve | TakeOff | ReturnHome, Some((_, nav))) => {
                    self.flight.hold(nav.pos_enu_m);
                    AckStatus::Accepted
                }
                _ => AckStatus::WrongPhase,
            },
            Command::ReturnHome => {
                if self.mission.is_none() || !self.flight.airborne() {
                    return AckStatus::WrongPhase;
                }
                self.flight.return_home();
                AckStatus::Accepted
            }
            Command::Rekey(key) => {
                self.transmitter.control.offer(key.clone());
                AckStatus::Accepted
            }
            Command::PeerKey(key) => {
                self.transmitter.seal_peer(key);
                self.links.hear_mates_under(key);
                AckStatus::Accepted
            }
        }
    }

    /// Whether this mission is committed and its lanes are laid.
    fn is_ready(&self, header: &MissionHeader) -> bool {
        !self.lanes.is_empty() && self.mission.as_ref().is_some_and(|ready| ready.header == *header)
    }
}
