/* SPDX-License-Identifier: BSD-3-Clause */
/* libmodbus's server over a memory of coils and registers: modbus_memory PORT [once]; once: it closes each
 * connection behind its first answer. */
#include <stdlib.h>
#include <unistd.h>

#include <modbus.h>

int main(int argc, char **argv)
{
    modbus_t *server = argc > 1 ? modbus_new_tcp("127.0.0.1", (int)strtol(argv[1], NULL, 10)) : NULL;
    modbus_mapping_t *memory = modbus_mapping_new(100, 100, 100, 100);
    uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
    int listener = server && memory ? modbus_tcp_listen(server, 4) : -1;

    while (listener >= 0) {
        int n;

        if (modbus_tcp_accept(server, &listener) < 0)
            return 1;
        do {
            n = modbus_receive(server, request);
            if (n > 0)
                n = modbus_reply(server, request, n, memory);
        } while (n >= 0 && argc < 3);
        modbus_close(server);
    }
    return 1;
}
