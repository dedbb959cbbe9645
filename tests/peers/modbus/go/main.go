// SPDX-License-Identifier: BSD-3-Clause

// simonvetter/modbus' server over a memory of coils and holding registers: server PORT
package main

import (
	"fmt"
	"os"
	"sync"
	"time"

	"github.com/simonvetter/modbus"
)

type memory struct {
	mutex     sync.Mutex
	registers [65536]uint16
	coils     [65536]bool
}

func (m *memory) HandleCoils(r *modbus.CoilsRequest) (got []bool, err error) {
	m.mutex.Lock()
	defer m.mutex.Unlock()
	for i := 0; i < int(r.Quantity); i++ {
		if r.IsWrite {
			m.coils[int(r.Addr)+i] = r.Args[i]
		}
		got = append(got, m.coils[int(r.Addr)+i])
	}
	return
}

func (m *memory) HandleDiscreteInputs(r *modbus.DiscreteInputsRequest) ([]bool, error) {
	return m.HandleCoils(&modbus.CoilsRequest{Addr: r.Addr, Quantity: r.Quantity})
}

func (m *memory) HandleHoldingRegisters(r *modbus.HoldingRegistersRequest) (got []uint16, err error) {
	m.mutex.Lock()
	defer m.mutex.Unlock()
	for i := 0; i < int(r.Quantity); i++ {
		if r.IsWrite {
			m.registers[int(r.Addr)+i] = r.Args[i]
		}
		got = append(got, m.registers[int(r.Addr)+i])
	}
	return
}

func (m *memory) HandleInputRegisters(r *modbus.InputRegistersRequest) ([]uint16, error) {
	return m.HandleHoldingRegisters(&modbus.HoldingRegistersRequest{Addr: r.Addr, Quantity: r.Quantity})
}

func main() {
	server, err := modbus.NewServer(&modbus.ServerConfiguration{
		URL: "tcp://127.0.0.1:" + os.Args[1], Timeout: 30 * time.Second, MaxClients: 5}, &memory{})
	if err == nil {
		err = server.Start()
	}
	if err != nil {
		fmt.Fprintln(os.Stderr, err)
		os.Exit(1)
	}
	select {}
}
