//! Frames in: decoded, checked against the sequence window, and handed to whom they concern.

use super::FlightAgent;
use crate::{
    Vec3,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{
    codec::{decode_body, split},
    error::DecodeError,
    header::Kind,
    message::{AckStatus, Down, Peer},
    session::Receiver,
    units::{CommandId, DroneId, TimePs, m_from_mm},
};

/// What is known of the links.
#[derive(Clone, Debug)]
pub(super) struct Links {
    control: Receiver,
    /// One for each fleet mate, by position in the mission's list of mates.
    mates: [Receiver; 3],
    /// Last word of each.
    mates_heard: [TimePs; 3],
    /// Last word of the control center.
    pub(super) control_heard: TimePs,
    /// Whether the control center answered the hello.
    pub(super) welcomed: bool,
    /// Last command executed, and what was answered.
    pub(super) last_command: Option<(CommandId, AckStatus)>,
}

impl Links {
    /// Nothing heard.
    pub(super) const fn new() -> Self {
        Self {
            control: Receiver::new(),
            mates: [const { Receiver::new() }; 3],
            mates_heard: [TimePs(0); 3],
            control_heard: TimePs(0),
            welcomed: false,
            last_command: None,
        }
    }

    /// Frames that the control center sent and that never arrived.
    pub(super) fn frames_lost(&self) -> u32 {
        self.control.counters().lost
    }
}

/// Why a frame was not taken in.
enum Fault {
    /// It does not decode.
    Rejected,
    /// Seen before, or too old.
    Repeated,
    /// Nothing that this link should carry.
    Unexpected,
}

impl From<DecodeError> for Fault {
    fn from(_: DecodeError) -> Self {
        Self::Rejected
    }
}

impl FlightAgent {
    /// Takes in all frames of this step.
    pub(super) fn receive(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) {
        for frame in &inputs.frames {
            let Err(fault) = self.receive_frame(now, frame, outputs) else { continue };
            let counters = &mut self.counters;
            Counters::count(match fault {
                Fault::Rejected => &mut counters.frames_rejected,
                Fault::Repeated => &mut counters.frames_repeated,
                Fault::Unexpected => &mut counters.frames_unexpected,
            });
        }
        if !inputs.attached.is_empty() {
            self.transmitter.attached(now, &inputs.attached, outputs, &mut self.counters);
        }
    }

    fn receive_frame(&mut self, now: TimePs, frame: &[u8], outputs: &mut Outputs) -> Result<(), Fault> {
        let (header, body) = split(frame)?;
        match header.kind {
            Kind::Down if header.sender == DroneId::CONTROL => {
                let message = decode_body(body)?;
                if !self.links.control.accept(&header).is_accepted() {
                    return Err(Fault::Repeated);
                }
                self.links.control_heard = now;
                self.on_down(now, &message, outputs);
            }
            Kind::Peer => {
                let message = decode_body(body)?;
                let (receiver, heard) = self.mate(header.sender).ok_or(Fault::Unexpected)?;
                if !receiver.accept(&header).is_accepted() {
                    return Err(Fault::Repeated);
                }
                *heard = now;
                self.on_peer(now, header.sender, &message);
            }
            // What drones tell the control center is not even decoded: boards carry no code for it.
            Kind::Down | Kind::Up => return Err(Fault::Unexpected),
        }
        Ok(())
    }

    /// The sequence window of a fleet mate and when it was last heard; none for anybody else.
    fn mate(&mut self, sender: DroneId) -> Option<(&mut Receiver, &mut TimePs)> {
        let mates = self.mission.as_ref()?.mates?;
        let place = mates.iter().position(|mate| *mate == sender && sender != self.config.id)?;
        Some((self.links.mates.get_mut(place)?, self.links.mates_heard.get_mut(place)?))
    }

    /// The last word of the mate that has been silent the longest, `since` at the earliest; none outside of a fleet.
    pub(super) fn mates_heard(&self, since: TimePs) -> Option<TimePs> {
        let mates = self.mission.as_ref()?.mates?;
        let others = mates.iter().zip(self.links.mates_heard).filter(|(mate, _)| **mate != self.config.id);
        others.map(|(_, heard)| heard.max(since)).min()
    }

    fn on_down(&mut self, now: TimePs, message: &Down, outputs: &mut Outputs) {
        match message {
            Down::Welcome { .. } => self.links.welcomed = true,
            Down::Heartbeat => {}
            Down::Command { id, command } => self.obey(*id, command, outputs),
            Down::LanePiece(piece) => self.upload.piece(piece, &mut self.lanes, &mut self.counters),
            Down::SrsRequest(request) => self.srs.announce(now, request, &mut self.counters),
            Down::Peers(states) => {
                // Before the first fix nobody is near: who is kept does not matter on the ground.
                let own_m = self.nav.map_or_else(Vec3::zeros, |(_, nav)| nav.pos_enu_m);
                for state in states.iter().filter(|s| s.drone != self.config.id) {
                    self.peers.update(state, &own_m, &mut self.counters);
                }
            }
        }
    }

    fn on_peer(&mut self, now: TimePs, sender: DroneId, message: &Peer) {
        match message {
            Peer::Captures(captures) => {
                for capture in captures {
                    self.srs.mate(now, self.config.id, sender, capture);
                }
            }
            Peer::SweepPhase { time, phase_um, rate_mmps, track_error_mm } => {
                let rate_mps = m_from_mm(i32::from(*rate_mmps));
                let error_m = *track_error_mm as f32 * 1e-3;
                self.flight.zigzag.hear(sender, *time, *phase_um, rate_mps, error_m);
            }
        }
    }
}
