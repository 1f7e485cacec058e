!> The paper's beam against a rigid wall, from numbers: no input file, no result file.
program wall
   use hb_document, only: document_t, new_document
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: read_model
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome_text
   use hb_properties, only: properties_t
   implicit none
   type(document_t), target :: document
   type(properties_t), pointer :: group
   type(model_t) :: model
   type(motion_result_t) :: motion
   type(error_t), allocatable :: error
   integer :: dof, tone

   call new_document(document)
   group => document%add("structure")
   call group%set("type", "beam")
   call group%set("length", 1.0_wp)                                   ! [m]
   call group%set("bending_stiffness", 1750.0_wp)                     ! [N m2]
   call group%set("mass_per_length", 7.8_wp)                          ! [kg/m]
   call group%set("n_elements", 4)                                    ! midspan is v3
   call group%set("damping_diagonal", 1.0_wp)                         ! [N s/m]
   group => document%add("tones")
   call group%set("frequency", [exp(1.0_wp), acos(-1.0_wp)])          ! [rad/s]
   group => document%add("harmonics")
   call group%set("order", 12)
   group => document%add("sampling")
   call group%set("samples", 64)
   do tone = 1, 2
      group => document%add("load")
      call group%set("dof", "v3")
      call group%set("tuple", merge([1, 0], [0, 1], tone == 1))
      call group%set("cos", 100.0_wp)                                 ! [N]
   end do
   group => document%add("law")
   call group%set("type", "rigid_wall")
   call group%set("dof", "v3")
   call group%set("gap", 1.5e-3_wp)                                   ! [m]
   call group%set("augmentation", 1.0e5_wp)                           ! [N/m]

   call read_model(model, document, error)
   if (.not. allocated(error)) call solve_motion(model, motion, error)
   if (allocated(error)) error stop error%message
   call model%structure%find_dof("v3", dof, error)
   print "(a)", outcome_text(motion%status)
   print "(a, es21.14, a)", "cos tau_1 at midspan: ", motion%coefficients(1, model%harmonics%index_of([1, 0]), dof), " m"
end program wall
