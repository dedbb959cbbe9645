# SPDX-License-Identifier: BSD-3-Clause
# cmake --install: headers, both libraries, programs, the experiments, apc.pc, apc-static.pc and the CMake package,
# documents and examples.
include(CMakePackageConfigHelpers)
set(APC_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/apc)

install(TARGETS apc EXPORT apcTargets)
install(TARGETS apc_static EXPORT apcStaticTargets)
install(TARGETS ${APC_PROGRAMS} apc_cli)
if(TARGET apc-fmu-controller) # as it is: it finds what goes with it beside itself, in an FMU
  install(FILES $<TARGET_FILE:apc-fmu-controller> DESTINATION ${CMAKE_INSTALL_LIBDIR}/apc)
endif()
if(NOT APC_POSTGRESQL) # it includes libpq's
  set(APC_LEFT_OUT PATTERN apcshareddata.h EXCLUDE)
endif()
install(DIRECTORY include/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} FILES_MATCHING PATTERN "apc*.h" ${APC_LEFT_OUT})
install(DIRECTORY experiments/ DESTINATION ${CMAKE_INSTALL_DATADIR}/apc FILES_MATCHING PATTERN "*.conf" PATTERN "*.scenario" PATTERN "*.svg")
if(APC_PAGE_DIR)
  install(DIRECTORY ${APC_PAGE_DIR}/ DESTINATION ${CMAKE_INSTALL_DATADIR}/apc/ui)
endif()
install(DIRECTORY sql DESTINATION ${CMAKE_INSTALL_DATADIR}/apc)
install(FILES LICENSE CHANGELOG.md CITATION.cff TYPE DOC)

# Documents: with links among themselves and to the examples; what is in the sources only is named without a link.
file(GLOB documents CONFIGURE_DEPENDS RELATIVE ${PROJECT_SOURCE_DIR} docs/*.md)
file(REMOVE_RECURSE ${PROJECT_BINARY_DIR}/install/docs)
foreach(document README.md SECURITY.md ${documents})
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${document})
  file(READ ${document} text)
  string(REGEX REPLACE "\\[([^]]+)\\]\\((\\.\\./)?(src|apps|ui|bench|scripts|tests|include|sql|experiments|cmake|sources|LICENSE|README|CONTRIBUTING)[^)]*\\)"
                       "\\1" text "${text}")
  file(WRITE ${PROJECT_BINARY_DIR}/install/${document} "${text}")
endforeach()
install(FILES ${PROJECT_BINARY_DIR}/install/README.md ${PROJECT_BINARY_DIR}/install/SECURITY.md TYPE DOC)
install(DIRECTORY ${PROJECT_BINARY_DIR}/install/docs TYPE DOC FILES_MATCHING PATTERN "*.md")
install(DIRECTORY docs TYPE DOC PATTERN "*.md" EXCLUDE)
install(DIRECTORY examples TYPE DOC)
# The tutorial has them where they are in the sources.
file(RELATIVE_PATH experiments /${CMAKE_INSTALL_DOCDIR} /${CMAKE_INSTALL_DATADIR}/apc)
install(CODE "file(CREATE_LINK \"${experiments}\" \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_DOCDIR}/experiments\" SYMBOLIC)")

# The static library is a package component of its own: it needs SUNDIALS where the shared one does not.
install(EXPORT apcTargets NAMESPACE apc:: DESTINATION ${APC_CMAKE_DIR})
install(EXPORT apcStaticTargets NAMESPACE apc:: DESTINATION ${APC_CMAKE_DIR})
configure_package_config_file(cmake/apcConfig.cmake.in ${PROJECT_BINARY_DIR}/apcConfig.cmake
                              INSTALL_DESTINATION ${APC_CMAKE_DIR})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/apcConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/apcConfig.cmake ${PROJECT_BINARY_DIR}/apcConfigVersion.cmake
        DESTINATION ${APC_CMAKE_DIR})

# The prefix follows the file, so that the tree may be installed anywhere and moved.
file(RELATIVE_PATH up /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
string(REGEX REPLACE "/$" "" up ${up})
set(APC_PC_PREFIX "\${pcfiledir}/${up}")
if(SSL_FOUND)
  set(APC_SSL_LIB "-lssl ")
endif()
if(APC_SQLITE)
  set(APC_SQLITE_LIB "-lsqlite3 ")
endif()
if(SUNDIALS_VERSION VERSION_GREATER_EQUAL 7)
  set(APC_SUNDIALS_LIB "-lsundials_core ")
  if(TARGET SUNDIALS::core_shared)
    get_target_property(needs SUNDIALS::core_shared INTERFACE_LINK_LIBRARIES)
    if(needs MATCHES MPI)
      string(APPEND APC_SUNDIALS_LIB "-lmpi ")
    endif()
  endif()
endif()
if(APC_POSTGRESQL)
  set(APC_PQ_PC libpq)
endif()
foreach(pc apc apc-static)
  configure_file(cmake/${pc}.pc.in ${PROJECT_BINARY_DIR}/${pc}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/${pc}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()
