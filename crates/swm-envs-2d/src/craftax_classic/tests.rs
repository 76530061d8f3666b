//! What Craftax-Classic promises beyond conformance.
