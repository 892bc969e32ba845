pub mod measure; pub mod workload;
