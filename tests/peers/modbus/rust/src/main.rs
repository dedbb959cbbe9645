// SPDX-License-Identifier: BSD-3-Clause
//! tokio-modbus' server over a memory of coils and holding registers: server PORT
use std::{
    future,
    sync::{Arc, Mutex},
};
use tokio_modbus::{prelude::*, server::tcp::Server};

struct Memory {
    registers: Mutex<Vec<u16>>,
    coils: Mutex<Vec<bool>>,
}

impl tokio_modbus::server::Service for Memory {
    type Request = Request<'static>;
    type Response = Response;
    type Exception = ExceptionCode;
    type Future = future::Ready<Result<Response, ExceptionCode>>;

    fn call(&self, request: Self::Request) -> Self::Future {
        let mut registers = self.registers.lock().unwrap();
        let mut coils = self.coils.lock().unwrap();
        let span = |at: u16, n: usize| at as usize..at as usize + n;
        future::ready(match request {
            Request::ReadHoldingRegisters(at, n) => Ok(Response::ReadHoldingRegisters(registers[span(at, n as usize)].to_vec())),
            Request::ReadInputRegisters(at, n) => Ok(Response::ReadInputRegisters(registers[span(at, n as usize)].to_vec())),
            Request::ReadCoils(at, n) => Ok(Response::ReadCoils(coils[span(at, n as usize)].to_vec())),
            Request::ReadDiscreteInputs(at, n) => Ok(Response::ReadDiscreteInputs(coils[span(at, n as usize)].to_vec())),
            Request::WriteSingleRegister(at, value) => {
                registers[at as usize] = value;
                Ok(Response::WriteSingleRegister(at, value))
            }
            Request::WriteMultipleRegisters(at, values) => {
                registers[span(at, values.len())].copy_from_slice(&values);
                Ok(Response::WriteMultipleRegisters(at, values.len() as u16))
            }
            Request::WriteSingleCoil(at, value) => {
                coils[at as usize] = value;
                Ok(Response::WriteSingleCoil(at, value))
            }
            Request::WriteMultipleCoils(at, values) => {
                coils[span(at, values.len())].copy_from_slice(&values);
                Ok(Response::WriteMultipleCoils(at, values.len() as u16))
            }
            _ => Err(ExceptionCode::IllegalFunction),
        })
    }
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> std::io::Result<()> {
    let port: u16 = std::env::args().nth(1).and_then(|text| text.parse().ok()).expect("server PORT");
    let memory = Arc::new(Memory { registers: Mutex::new(vec![0; 66000]), coils: Mutex::new(vec![false; 66000]) });
    let server = Server::new(tokio::net::TcpListener::bind(("127.0.0.1", port)).await?);
    let connected = |stream, address| {
        let memory = memory.clone();
        async move { tokio_modbus::server::tcp::accept_tcp_connection(stream, address, move |_| Ok(Some(memory.clone()))) }
    };
    server.serve(&connected, |error| eprintln!("{error}")).await
}
