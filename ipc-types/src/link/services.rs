//! The two message services of a lane: their names, their settings, and the attributes by which both sides agree.

use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::Node;
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, MessagingPattern, NodeState, PortFactory as _, SemanticString,
    Service as _, ServiceName, ZeroCopySend,
};
use iceoryx2::service::attribute::{AttributeKey, AttributeSet, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::{
    Builder, PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use super::error::LinkError;
use super::lane_spec::LaneSpec;
use super::node::LinkNode;
use super::retry::Attempt;
use super::type_names::Ipc;
use crate::layout::Page;

/// A service that carries messages with header `H`.
pub(super) type Messages<H> = PortFactory<Ipc, [Page], H>;

/// Processes that may know a service at a time: two, and those that have died and are not reaped yet.
const MAX_NODES: usize = 16;

/// Name of a lane's service.
pub(super) fn lane_service(spec: &LaneSpec, what: &str) -> String {
    format!("hyp/lane/{}/{what}", spec.lane)
}

/// What both sides of a lane must agree on, as the attributes of its services. The run is told, not compared.
pub(super) struct Agreement<'a> {
    pub(super) schema_hash: u64,
    pub(super) spec: &'a LaneSpec,
}

impl Agreement<'_> {
    fn fields(&self) -> [(&'static str, String); 6] {
        let Self { schema_hash, spec } = self;
        [
            ("schema", format!("{schema_hash:016x}")),
            ("lane", spec.lane.to_string()),
            ("policy", spec.policy.clone()),
            ("max_envs", spec.max_envs.to_string()),
            ("block_pages", spec.block_pages.to_string()),
            ("in_flight", spec.in_flight.to_string()),
        ]
    }

    /// The first attribute that a service has otherwise.
    fn check(&self, service: &str, attributes: &AttributeSet) -> Result<(), LinkError> {
        for (field, expected) in self.fields() {
            let found = attribute_key(service, field)
                .map(|key| attributes.key_value(&key, 0).map_or("absent".into(), ToString::to_string))?;
            if found == expected {
                continue;
            }
            return Err(match u64::from_str_radix(&found, 16) {
                Ok(found) if field == "schema" => LinkError::Schema { expected: self.schema_hash, found },
                _ => LinkError::Spec { service: service.into(), field, expected, found },
            });
        }
        Ok(())
    }

    fn verifier(&self, service: &str, run: u64) -> Result<AttributeVerifier, LinkError> {
        let mut verifier = AttributeVerifier::new();
        for (field, value) in self.fields().into_iter().chain([("run", format!("{run:016x}"))]) {
            let value =
                AttributeValue::new(value.as_bytes()).map_err(|error| refused(service, field, &error))?;
            verifier = verifier
                .require(&attribute_key(service, field)?, &value)
                .map_err(|error| refused(service, field, &error))?;
        }
        Ok(verifier)
    }
}

/// Creates a message service, or opens the one that a dead sim has left to its host.
pub(super) fn create<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
    run: u64,
    agreement: &Agreement<'_>,
) -> Result<Messages<H>, Attempt> {
    use PublishSubscribeOpenOrCreateError::{
        PublishSubscribeCreateError as Create, PublishSubscribeOpenError as Open, SystemInFlux,
    };
    let verifier = agreement.verifier(service, run)?;
    let in_flight = agreement.spec.in_flight as usize;
    builder(node, service)?
        .enable_safe_overflow(false)
        .history_size(0)
        .max_publishers(1)
        .max_subscribers(1)
        .max_nodes(MAX_NODES)
        .subscriber_max_buffer_size(in_flight)
        .subscriber_max_borrowed_samples(in_flight)
        .open_or_create_with_attributes(&verifier)
        .map_err(|error| match error {
            Open(PublishSubscribeOpenError::IncompatibleAttributes) => {
                Attempt::Never(match find(node, service, agreement) {
                    Err(Attempt::Never(difference)) => difference,
                    _ => failed(service, &error),
                })
            }
            Open(error) => open_failure(service, error),
            Create(
                PublishSubscribeCreateError::AlreadyExists
                | PublishSubscribeCreateError::IsBeingCreatedByAnotherInstance
                | PublishSubscribeCreateError::HangsInCreation,
            )
            | SystemInFlux => Attempt::Later(failed(service, &error)),
            Create(_) => Attempt::Never(failed(service, &error)),
        })
}

/// Opens a message service that a sim has created.
pub(super) fn open<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
    agreement: &Agreement<'_>,
) -> Result<Messages<H>, Attempt> {
    // Attributes first: another schema may well have other types, and the schema is what the user can mend.
    find(node, service, agreement)?;
    builder(node, service)?.open().map_err(|error| open_failure(service, error))
}

/// Whether the node of an attached port lives. One that is just being cleaned up cannot be read, and does not.
pub(super) fn is_alive<H: ZeroCopySend + core::fmt::Debug>(
    messages: &Messages<H>,
    node: UniqueNodeId,
) -> bool {
    let mut alive = false;
    let listed = messages.nodes(|state| {
        alive |=
            *state.node_id() == node && matches!(state, NodeState::Alive(_) | NodeState::Inaccessible(_));
        CallbackProgression::Continue
    });
    alive && listed.is_ok()
}

fn find(node: &LinkNode, service: &str, agreement: &Agreement<'_>) -> Result<(), Attempt> {
    match Ipc::details(&service_name(service)?, node.config(), MessagingPattern::PublishSubscribe) {
        Ok(Some(details)) => Ok(agreement.check(service, details.static_details.attributes())?),
        Ok(None) => Err(Attempt::Later(LinkError::Absent { service: service.into() })),
        Err(error) => Err(Attempt::Later(failed(service, &error))),
    }
}

fn builder<H: ZeroCopySend + core::fmt::Debug>(
    node: &LinkNode,
    service: &str,
) -> Result<Builder<[Page], H, Ipc>, LinkError> {
    let node: &Node<Ipc> = node.inner();
    Ok(node.service_builder(&service_name(service)?).publish_subscribe::<[Page]>().user_header::<H>())
}

fn open_failure(service: &str, error: PublishSubscribeOpenError) -> Attempt {
    use PublishSubscribeOpenError as E;
    match error {
        E::DoesNotExist | E::HangsInCreation | E::IsMarkedForDestruction => {
            Attempt::Later(LinkError::Absent { service: service.into() })
        }
        E::ExceedsMaxNumberOfNodes => Attempt::Later(occupied(service, &error)),
        E::IncompatibleTypes => Attempt::Never(LinkError::Types { service: service.into() }),
        E::Interrupt => Attempt::Later(failed(service, &error)),
        _ => Attempt::Never(failed(service, &error)),
    }
}

/// The service's name as iceoryx2 wants it.
pub(super) fn service_name(service: &str) -> Result<ServiceName, LinkError> {
    ServiceName::new(service).map_err(|error| failed(service, &error))
}

/// Somebody else has the only place.
pub(super) fn occupied(service: &str, reason: &dyn core::fmt::Debug) -> LinkError {
    LinkError::Occupied { service: service.into(), reason: format!("{reason:?}") }
}

/// A failure of iceoryx2 that has no name of its own here.
pub(super) fn failed(service: &str, reason: &dyn core::fmt::Debug) -> LinkError {
    LinkError::Service { service: service.into(), reason: format!("{reason:?}") }
}

fn attribute_key(service: &str, field: &str) -> Result<AttributeKey, LinkError> {
    AttributeKey::new(field.as_bytes()).map_err(|error| refused(service, field, &error))
}

fn refused(service: &str, field: &str, error: &dyn core::fmt::Debug) -> LinkError {
    LinkError::Service { service: service.into(), reason: format!("attribute {field}: {error:?}") }
}
