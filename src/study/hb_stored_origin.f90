!> A point of a result file at which other motions leave a curve, as the origin of their curve.
module hb_stored_origin
   use hb_curve_plan, only: curve_plan_t
   use hb_curve_request, only: curve_origin_t, curve_request_t, new_curve_origin
   use hb_discretisation, only: discretisation_t
   use hb_document, only: document_t
   use hb_error, only: error_t, fail
   use hb_file_location, only: check_source
   use hb_hdf5, only: open_file
   use hb_model, only: model_t
   use hb_motion_result, only: curve_position_t
   use hb_options, only: options_t
   use hb_outcome, only: outcome
   use hb_point_kinds, only: beginning, curve_kinds
   use hb_results_record, only: reject_damaged_rows
   use hb_stored_rows, only: stored_file_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   implicit none
   private
   public :: request_curve

contains

   !> Creates the request of a plan, with its origin in a file.
   subroutine request_curve(plan, model, document, request, error)
      type(curve_plan_t), intent(in) :: plan
      type(model_t), intent(inout) :: model                           !! at the start; unchanged
      type(document_t), intent(in) :: document                        !! from which it was read
      type(curve_request_t), intent(out) :: request
      type(error_t), allocatable, intent(out) :: error

      call plan%make_request(model, document, request, error)
      if (allocated(error) .or. len(plan%origin_path) == 0) return
      allocate (request%origin)
      call read_curve_origin(request%origin, plan%origin_path, plan%origin_point, model%system, model%discretisation, &
                             model%options, error)
      if (allocated(error)) error%message = plan%location//": origin: "//error%message
   end subroutine request_curve

   !> Reads the point; fails if it is damaged, is neither a period doubling nor a torus bifurcation, or does not fit
   !> the model.
   subroutine read_curve_origin(self, path, point, system, discretisation, options, error)
      type(curve_origin_t), intent(out) :: self
      character(*), intent(in) :: path                                !! of the file
      integer, intent(in) :: point                                    !! from 0
      type(system_t), intent(in) :: system                            !! of the new curve
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(error_t), allocatable, intent(out) :: error
      type(stored_file_t) :: stored
      type(curve_position_t) :: position
      integer, allocatable :: status(:), tuples(:, :)

      call check_source(path, error)
      if (allocated(error)) return
      call open_file(stored%file, path, error)
      call stored%list(error)
      if (.not. allocated(error) .and. point >= stored%plan%length_of("point")) &
         call fail(error, "the file has "//to_text(stored%plan%length_of("point"))//" points")
      call stored%fetch("status", status, error)
      call stored%get_position(point + 1, position, error)
      call stored%get_tuples(point + 1, tuples, error)
      call stored%file%close(error)
      if (.not. allocated(error)) call reject_damaged_rows(path, status, [point], error)
      if (.not. allocated(error)) then
         if (options%lacks_impacts_of(system, outcome%impact)) then
            call adopt_state(self, position, system, error)
         else if (curve_kinds(position%kind)%begins /= beginning%nothing .and. &
                  .not. curve_kinds(position%kind)%multipliers_jump) then
            call new_curve_origin(self, curve_kinds(position%kind)%begins == beginning%torus, position, tuples, system, &
                                  discretisation, options, error)
         else
            call fail(error, &
                      "it is neither a 'period_doubling' nor a 'neimark_sacker'; 'nhbm info' and 'nhbm-post peaks' list those")
         end if
      end if
      if (allocated(error)) error%message = "point "//to_text(point)//" of '"//path//"': "//error%message
   end subroutine read_curve_origin

   !> Takes the state of a motion with impacts whose period doubles; fails at other points.
   subroutine adopt_state(self, position, system, error)
      type(curve_origin_t), intent(inout) :: self
      type(curve_position_t), intent(in) :: position
      type(system_t), intent(in) :: system
      type(error_t), allocatable, intent(out) :: error

      if (curve_kinds(position%kind)%begins /= beginning%doubled_period) then
         call fail(error, "it is no 'period_doubling', the only origin of motions with impacts; 'nhbm info' lists those. A "// &
                   "'neimark_sacker' leads to two tones: use a &sweep")
      else if (size(position%unknowns) /= 4*system%structure%n_dofs + 2) then
         call fail(error, "its motion does not fit the walls and degrees of freedom of this input")
      else
         self%u = reshape(position%unknowns, [size(position%unknowns), 1])
         self%further = position%unknowns(size(position%unknowns):)
      end if
   end subroutine adopt_state
end module hb_stored_origin
