//! Frames in: decoded, checked against the sequence window, and handed to whom they concern.

use super::FlightAgent;
use crate::{
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{
    codec::{Message, decode},
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

impl FlightAgent {
    /// Takes in all frames of this step.
    pub(super) fn receive(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) {
        for frame in &inputs.frames {
            match decode(frame) {
                Ok((header, Message::Down(message))) if header.sender == DroneId::CONTROL => {
                    if self.links.control.accept(&header).is_accepted() {
                        self.links.control_heard = now;
                        self.on_down(now, &message, outputs);
                    } else {
                        Counters::count(&mut self.counters.frames_repeated);
                    }
                }
                Ok((header, Message::Peer(message))) => {
                    match self.mate(header.sender).map(|receiver| receiver.accept(&header).is_accepted()) {
                        Some(true) => self.on_peer(now, header.sender, &message),
                        Some(false) => Counters::count(&mut self.counters.frames_repeated),
                        None => Counters::count(&mut self.counters.frames_unexpected),
                    }
                }
                Ok(_) => Counters::count(&mut self.counters.frames_unexpected),
                Err(_) => Counters::count(&mut self.counters.frames_rejected),
            }
        }
        if !inputs.attached.is_empty() {
            self.transmitter.attached(now, &inputs.attached, outputs, &mut self.counters);
        }
    }

    /// The sequence window of a fleet mate; none for anybody else.
    fn mate(&mut self, sender: DroneId) -> Option<&mut Receiver> {
        let mates = self.mission.as_ref()?.mates?;
        let known = mates.iter().zip(&mut self.links.mates);
        known.filter(|(mate, _)| **mate == sender && sender != self.config.id).map(|(_, r)| r).next()
    }

    fn on_down(&mut self, now: TimePs, message: &Down, outputs: &mut Outputs) {
        match message {
            Down::Welcome { .. } => self.links.welcomed = true,
            Down::Heartbeat => {}
            Down::Command { id, command } => self.obey(*id, command, outputs),
            Down::LanePiece(piece) => self.upload.piece(piece, &mut self.lanes, &mut self.counters),
            Down::SrsRequest(request) => self.srs.announce(now, request, &mut self.counters),
            Down::Peers(states) => {
                for state in states.iter().filter(|s| s.drone != self.config.id) {
                    self.peers.update(state, &mut self.counters);
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
