!> The paper's beam against a rigid wall, from numbers: no input file, no result file.
program wall
   use hb_beam, only: beam_t
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t, new_box
   use hb_kinds, only: wp
   use hb_law_rigid_wall, only: rigid_wall_t
   use hb_model, only: model_t
   use hb_motion, only: solve_motion
   use hb_motion_result, only: motion_result_t
   use hb_new_model, only: add_law, add_load, new_model
   use hb_outcome, only: outcome_text
   implicit none
   real(wp), parameter :: omega(2) = [exp(1.0_wp), acos(-1.0_wp)]     ! [rad/s]
   type(beam_t) :: beam
   type(harmonics_t) :: harmonics
   type(model_t) :: model
   type(motion_result_t) :: motion
   type(rigid_wall_t) :: stop
   type(error_t), allocatable :: error
   integer :: midspan

   beam%length = 1.0_wp                                               ! [m]
   beam%bending_stiffness = 1750.0_wp                                 ! [N m2]
   beam%mass_per_length = 7.8_wp                                      ! [kg/m]
   beam%n_elements = 4                                                ! midspan is v3
   beam%proportional%diagonal = 1.0_wp                                ! [N s/m]
   stop%gap = 1.5e-3_wp                                               ! [m]
   stop%augmentation = 1.0e5_wp                                       ! [N/m]

   call new_box(harmonics, [12, 12], .false., error)
   if (.not. allocated(error)) call new_model(model, beam, omega, harmonics, [64, 64], error)
   if (.not. allocated(error)) call add_law(model, stop, ["v3"], error)
   if (.not. allocated(error)) call add_load(model, "v3", [1, 0], 100.0_wp, 0.0_wp, error)
   if (.not. allocated(error)) call add_load(model, "v3", [0, 1], 100.0_wp, 0.0_wp, error)
   if (.not. allocated(error)) call solve_motion(model, motion, error)
   if (allocated(error)) error stop error%message
   midspan = model%system%structure%dof_index("v3")
   print "(a)", outcome_text(motion%status)
   print "(a, es21.14, a)", "cos tau_1 at midspan: ", motion%coefficients(1, harmonics%index_of([1, 0]), midspan), " m"
end program wall
