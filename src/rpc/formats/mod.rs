//! Files that hold RPCs, one module a vendor format.
