// SPDX-License-Identifier: BSD-3-Clause
// modbus-serial's server over a memory of coils and holding registers: server.mjs PORT
import modbus from "modbus-serial";

const registers = new Uint16Array(65536), coils = new Uint8Array(65536);
new modbus.ServerTCP(
  {
    getHoldingRegister: (at) => registers[at],
    getInputRegister: (at) => registers[at],
    getCoil: (at) => coils[at] === 1,
    getDiscreteInput: (at) => coils[at] === 1,
    setRegister: (at, value) => {
      registers[at] = value;
    },
    setCoil: (at, value) => {
      coils[at] = value ? 1 : 0;
    },
  },
  { host: "127.0.0.1", port: Number(process.argv[2]), unitID: 1 },
);
