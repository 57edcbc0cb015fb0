//! Frames in: decoded, checked against the sequence window, and handed to whom they concern.

use super::FlightAgent;
use crate::{
    Vec3,
    counters::Counters,
    io::{Inputs, Outputs},
};
use skyroost_protocol::{
    LinkFault,
    codec::{decode_body, parse},
    error::DecodeError,
    header::{Kind, MANAGEMENT_VERSION},
    key::{Key, Purpose, ROOM, Room},
    manage::Management,
    message::{AckStatus, Down, Peer},
    session::Receiver,
    units::{CommandId, DroneId, TimePs, m_from_mm},
};

/// What is known of the links.
#[derive(Clone, Debug)]
pub(super) struct Links {
    /// Opens what fleet mates say.
    peer_key: Option<Key>,
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
    /// The boot of the control center whose commands `last_command` is among.
    commands_of: Option<u16>,
}

impl Links {
    /// Nothing heard.
    pub(super) const fn new() -> Self {
        Self {
            peer_key: None,
            mates: [const { Receiver::new() }; 3],
            mates_heard: [TimePs(0); 3],
            control_heard: TimePs(0),
            welcomed: false,
            last_command: None,
            commands_of: None,
        }
    }

    /// Opens what fleet mates say with this key. Nothing was ever sealed with it, so their numbers begin anew: whoever had a mate's
    /// place before may have booted more often.
    pub(super) fn hear_mates_under(&mut self, key: &Key) {
        self.peer_key = Some(key.clone());
        self.mates = [const { Receiver::new() }; 3];
    }
}

impl FlightAgent {
    /// Takes in all frames of this step.
    pub(super) fn receive(&mut self, now: TimePs, inputs: &Inputs, outputs: &mut Outputs) {
        let mut room = ROOM;
        for frame in &inputs.frames {
            let Err(fault) = self.receive_frame(now, frame, &mut room, outputs) else { continue };
            let counters = &mut self.counters;
            Counters::count(match fault {
                LinkFault::Decode(DecodeError::Forged | DecodeError::Unsealed | DecodeError::Sealed) => {
                    &mut counters.frames_forged
                }
                LinkFault::Decode(_) => &mut counters.frames_rejected,
                LinkFault::Repeated => &mut counters.frames_repeated,
                LinkFault::Unexpected => &mut counters.frames_unexpected,
            });
        }
        if !inputs.attached.is_empty() {
            self.transmitter.attached(now, &inputs.attached, outputs, &mut self.counters);
        }
    }

    fn receive_frame(
        &mut self,
        now: TimePs,
        frame: &[u8],
        room: &mut Room,
        outputs: &mut Outputs,
    ) -> Result<(), LinkFault> {
        let parcel = match parse(frame) {
            Err(DecodeError::Version { found: MANAGEMENT_VERSION }) => {
                return self.managed(now, frame, outputs);
            }
            parcel => parcel?,
        };
        match parcel.header.kind {
            Kind::Down => {
                let opened = self.transmitter.control.open(frame, room)?;
                let (epoch, message) = (opened.header.boot_epoch, decode_body(opened.body)?);
                self.links.control_heard = now;
                self.on_down(now, epoch, &message, outputs);
            }
            Kind::Peer => {
                let header = parcel.header;
                self.mate(header.sender).ok_or(LinkFault::Unexpected)?;
                let body = match &self.links.peer_key {
                    Some(key) => {
                        let key = key.session(Purpose::Peer, header.sender, header.boot_epoch, 0);
                        parcel.open(&key, room)?
                    }
                    None if self.transmitter.control.is_sealed() => return Err(DecodeError::Sealed.into()),
                    None => parcel.plain()?,
                };
                let message = decode_body(body)?;
                let (receiver, heard) = self.mate(header.sender).ok_or(LinkFault::Unexpected)?;
                if !receiver.accept(&header).is_accepted() {
                    return Err(LinkFault::Repeated);
                }
                *heard = now;
                self.on_peer(now, header.sender, &message);
            }
            // What drones tell the control center is not even decoded: boards carry no code for it.
            Kind::Up | Kind::Management => return Err(LinkFault::Unexpected),
        }
        Ok(())
    }

    /// A control center of whatever version asks who this is. It may have asked long ago: the answer does no harm.
    fn managed(&mut self, now: TimePs, frame: &[u8], outputs: &mut Outputs) -> Result<(), LinkFault> {
        match self.transmitter.control.managed(frame)? {
            (_, Management::Identify) => self.transmitter.identify(now, outputs, &mut self.counters),
            (_, Management::Identity(_)) => return Err(LinkFault::Unexpected),
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

    fn on_down(&mut self, now: TimePs, epoch: u16, message: &Down, outputs: &mut Outputs) {
        match message {
            Down::Welcome { resumes, .. } => self.on_welcome(now, epoch, *resumes),
            Down::Heartbeat => {}
            Down::Command { id, command } => {
                // Of a boot that has not said whether its numbers go on, a number says nothing: it will say, and repeat.
                if *self.links.commands_of.get_or_insert(epoch) == epoch {
                    self.obey(now, *id, command, outputs);
                } else {
                    Counters::count(&mut self.counters.frames_unexpected);
                }
            }
            Down::LanePiece(piece) => self.upload.piece(piece, &mut self.lanes, &mut self.counters),
            Down::SrsRequest(request) => self.srs.announce(now, request, &mut self.counters),
            Down::Peers(states) => {
                // Before the first fix nobody is near: who is kept does not matter on the ground.
                let own_m = self.nav.map_or_else(Vec3::zeros, |(_, nav)| nav.pos_enu_m);
                for state in states.iter().filter(|s| s.drone != self.config.id) {
                    self.peers.update(state, &own_m, &mut self.counters);
                }
                self.peers.forget_gone(now);
            }
        }
    }

    /// The control center, at this boot of its own, has taken this drone in.
    fn on_welcome(&mut self, now: TimePs, epoch: u16, resumes: bool) {
        let links = &mut self.links;
        links.welcomed = true;
        if links.commands_of.replace(epoch) != Some(epoch) {
            if !resumes {
                links.last_command = None;
            }
            self.transmitter.welcomed(now);
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
