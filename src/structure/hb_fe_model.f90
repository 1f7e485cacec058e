!> Structure from a model created by another program: sparse matrices, labels, sets of nodes and load vectors.
!>
!> The caller provides models through an `fe_model_source_t`; that of the program reads files (hb_fe_model_file).
module hb_fe_model
   use hb_checksum, only: checksum
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_node_sets, only: named_vectors_t, node_sets_t
   use hb_numbers, only: number_t, numbers_t
   use hb_proportional_damping, only: proportional_damping_t
   use hb_sparse, only: sparse_sum, sparse_t
   use hb_structure, only: check_memory_of_structure, max_sparse_dofs, new_structure, structure_t
   use hb_structure_builder, only: structure_builder_t
   use hb_text, only: number_of, to_text
   implicit none
   private
   public :: fe_model_builder_t, fe_model_source_t, fe_model_t, max_speeds, new_fe_model_structure

   integer, parameter :: max_speeds = 2                              !! shafts with speeds of their own

   !> Terms of a speed Omega [rad/s]: Omega G multiplies the velocity, Omega K_1 + Omega**2 K_2 is added to the
   !> stiffness. Source: G. Genta, Dynamics of Rotating Systems, Springer 2005, chapter 4.
   type :: speed_terms_t
      type(sparse_t) :: gyroscopic                                    !! G [N s2/m], skew-symmetric
      type(sparse_t) :: stiffness                                     !! K_1 [N s/m], such as that of rotating damping
      type(sparse_t) :: stiffness_squared                             !! K_2 [N s2/m]
   end type speed_terms_t

   !> A model as read. Missing matrices, other than stiffness and mass, have no rows.
   type :: fe_model_t
      integer :: n_dofs = 0
      type(sparse_t) :: mass, stiffness                               !! [kg], [N/m]
      type(sparse_t) :: damping                                       !! [N s/m], viscous
      type(sparse_t) :: gyroscopic                                    !! [N s/m], skew-symmetric
      type(sparse_t) :: structural                                    !! [N/m]: H of the complex stiffness K + i H
      type(speed_terms_t) :: speeds(max_speeds)
      character(:), allocatable :: labels(:), units(:)                !! (n_dofs)
      type(node_sets_t) :: sets
      type(named_vectors_t) :: vectors
      real(wp) :: up_to = 0.0_wp                                      !! [rad/s], as of `structure_t`
   end type fe_model_t

   !> Source of models.
   type, abstract :: fe_model_source_t
   contains
      procedure(fetch_model), deferred :: fetch
   end type fe_model_source_t

   !> A model by its name, such as that of its file.
   type, extends(structure_builder_t) :: fe_model_builder_t
      character(:), allocatable :: name                               !! as given
      character(:), allocatable :: path                               !! for the source
      class(fe_model_source_t), allocatable :: source
      real(wp), allocatable :: speeds(:)                              !! [rad/s]
      real(wp) :: structural_frequency = 0.0_wp                       !! [rad/s]
      integer, private :: n_built = 0                                 ! structures
      type(fe_model_t), allocatable, private :: model                 ! retained from the second one on: its numbers move
   contains
      procedure :: declare_numbers => fe_model_builder_declare_numbers
      procedure :: is_affine_in => fe_model_builder_is_affine_in
      procedure :: build => fe_model_builder_build
   end type fe_model_builder_t

   abstract interface
      !> Returns the model of a name, such as that of a file. Sizes of its parts agree, numbers are finite.
      subroutine fetch_model(self, name, fe_model, error)
         import :: error_t, fe_model_source_t, fe_model_t
         class(fe_model_source_t), intent(in) :: self
         character(*), intent(in) :: name
         type(fe_model_t), intent(out) :: fe_model
         type(error_t), allocatable, intent(out) :: error
      end subroutine fetch_model
   end interface

contains

   subroutine fe_model_builder_declare_numbers(self, numbers)
      class(fe_model_builder_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("speed", self%speeds, required=.false.)
      call numbers%add("structural_frequency", self%structural_frequency, required=.false.)
      call self%proportional%declare_numbers(numbers)
   end subroutine fe_model_builder_declare_numbers

   pure logical function fe_model_builder_is_affine_in(self, number) result(is_affine)
      class(fe_model_builder_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = index(number%key, "damping") == 1
   end function fe_model_builder_is_affine_in

   !> Fetches the model for the first structure, beside which it takes no memory; it is retained if there are more.
   subroutine fe_model_builder_build(self, structure, error, memory_limit)
      class(fe_model_builder_t), intent(inout) :: self
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit
      type(fe_model_t), allocatable :: fe_model

      if (.not. allocated(self%source)) then
         call fail(error, "models cannot be read here: there is no source of models")
         return
      end if
      call move_alloc(self%model, fe_model)
      if (.not. allocated(fe_model)) then
         allocate (fe_model)
         call self%source%fetch(self%path, fe_model, error)
         if (allocated(error)) return
      end if
      call check_memory_of_structure(fe_model%n_dofs, error, memory_limit, fe_model%mass%n_entries() + &
                                     2*fe_model%stiffness%n_entries() + fe_model%damping%n_entries())
      if (.not. allocated(error)) call new_fe_model_structure(structure, fe_model, self%proportional, &
                                                              self%structural_frequency, self%speeds, error)
      structure%model_file = self%name
      if (.not. allocated(error)) structure%origin = "model '"//self%name//"': "//trim(structure_fingerprint(structure))
      self%n_built = self%n_built + 1
      if (self%n_built > 1) call move_alloc(fe_model, self%model)
   end subroutine fe_model_builder_build

   !> Creates a structure from a model. Structural damping becomes viscous damping that is equal at one frequency.
   !> Fails for a gyroscopic matrix that is not skew-symmetric, and as `new_structure` does.
   subroutine new_fe_model_structure(structure, fe_model, proportional, structural_frequency, speeds, error)
      type(structure_t), intent(out) :: structure
      type(fe_model_t), intent(in) :: fe_model
      type(proportional_damping_t), intent(in) :: proportional
      real(wp), intent(in) :: structural_frequency                    !! [rad/s], > 0 if there is structural damping
      real(wp), intent(in) :: speeds(:)                               !! [rad/s], one for each speed with terms in the model
      type(error_t), allocatable, intent(out) :: error
      type(sparse_t) :: damping, stiffness
      integer :: i

      if (fe_model%n_dofs > max_sparse_dofs) then
         call fail(error, "the model has "//to_text(fe_model%n_dofs)//" degrees of freedom, at most "//to_text(max_sparse_dofs)// &
                   " are taken as they are; 'nhbm-model reduce' makes a small model of a large one")
         return
      else if (fe_model%structural%n_rows == 0 .and. structural_frequency > 0.0_wp) then
         call fail(error, "the model has no structural damping H, so that structural_frequency has no effect; remove it")
         return
      else if (fe_model%structural%n_rows > 0 .and. .not. structural_frequency > 0.0_wp) then
         call fail(error, "the model has structural damping H; give structural_frequency, the frequency at which "// &
                    "the viscous damping "// &
                   "H/frequency that replaces it is equal to it")
         return
      end if
      damping = proportional%matrix(fe_model%mass, fe_model%stiffness)
      if (fe_model%damping%n_rows > 0) damping = sparse_sum(1.0_wp, damping, 1.0_wp, fe_model%damping)
      if (fe_model%structural%n_rows > 0) damping = sparse_sum(1.0_wp, damping, 1.0_wp/structural_frequency, fe_model%structural)
      call check_speeds(fe_model, speeds, error)
      if (allocated(error)) return
      stiffness = fe_model%stiffness
      call add_skew(1.0_wp, fe_model%gyroscopic)
      do i = 1, size(speeds)
         associate (terms => fe_model%speeds(i), speed => speeds(i))
            call add_skew(speed, terms%gyroscopic)
            if (terms%stiffness%n_rows > 0) stiffness = sparse_sum(1.0_wp, stiffness, speed, terms%stiffness)
            if (terms%stiffness_squared%n_rows > 0) stiffness = sparse_sum(1.0_wp, stiffness, speed**2, terms%stiffness_squared)
         end associate
      end do
      if (allocated(error)) return
      call new_structure(structure, fe_model%mass, damping, stiffness, fe_model%labels, fe_model%units, error)
      if (allocated(error)) return
      structure%sets = fe_model%sets
      structure%vectors = fe_model%vectors
      structure%up_to = fe_model%up_to

   contains

      subroutine add_skew(factor, matrix)
         real(wp), intent(in) :: factor
         type(sparse_t), intent(in) :: matrix

         if (matrix%n_rows == 0 .or. allocated(error)) return
         call check_skew(matrix, fe_model%labels, error)
         damping = sparse_sum(1.0_wp, damping, factor, matrix)
      end subroutine add_skew
   end subroutine new_fe_model_structure

   !> Fails unless there is a number for each speed with terms in the model.
   subroutine check_speeds(fe_model, speeds, error)
      type(fe_model_t), intent(in) :: fe_model
      real(wp), intent(in) :: speeds(:)
      type(error_t), allocatable, intent(out) :: error
      integer :: i, n

      n = 0
      do i = 1, max_speeds
         associate (terms => fe_model%speeds(i))
            if (terms%gyroscopic%n_rows + terms%stiffness%n_rows + terms%stiffness_squared%n_rows > 0) n = i
         end associate
      end do
      if (size(speeds) /= n) call fail(error, "the model has terms of "//number_of(n, "speed")//", 'speed' has "// &
                                       number_of(size(speeds), "number")//"; give one for each, in rad/s: speed = 300.0")
   end subroutine check_speeds

   subroutine check_skew(matrix, labels, error)
      type(sparse_t), intent(in) :: matrix
      character(*), intent(in) :: labels(:)
      type(error_t), allocatable, intent(out) :: error
      real(wp) :: tolerance
      integer :: e, i

      tolerance = 1.0e-10_wp*maxval(abs(matrix%value))
      do i = 1, matrix%n_rows
         do e = matrix%first(i), matrix%first(i + 1) - 1
            associate (j => matrix%column(e))
               if (abs(matrix%value(e) + matrix%at(j, i)) <= tolerance) cycle
               call fail(error, "the gyroscopic matrix must be skew-symmetric, between "//trim(labels(i))//" and "// &
                         trim(labels(j))//" it is "//to_text(matrix%value(e))//" one way and "//to_text(matrix%at(j, i))// &
                         " the other")
               return
            end associate
         end do
      end do
   end subroutine check_skew

   !> Checksum of all numbers and names of a structure, and its size, as text.
   function structure_fingerprint(structure) result(text)
      type(structure_t), intent(in) :: structure
      character(80) :: text
      integer :: i, sum

      sum = 0
      if (allocated(structure%sparse)) then
         associate (m => structure%sparse%mass, d => structure%sparse%damping, k => structure%sparse%stiffness)
            sum = with_sparse(with_sparse(with_sparse(sum, m), d), k)
         end associate
      else
         do i = 1, structure%n_dofs
            sum = checksum(checksum(checksum(sum, structure%mass(:, i)), structure%damping(:, i)), structure%stiffness(:, i))
         end do
      end if
      do i = 1, structure%n_dofs
         sum = checksum(checksum(sum, structure%labels(i)), structure%units(i))
      end do
      associate (sets => structure%sets, vectors => structure%vectors)
         if (allocated(sets%names)) then
            do i = 1, size(sets%names)
               sum = checksum(sum, sets%names(i))
            end do
            sum = checksum(checksum(sum, sets%first), sets%nodes)
         end if
         if (allocated(sets%node_of)) sum = checksum(sum, sets%node_of)
         if (allocated(vectors%names)) then
            do i = 1, size(vectors%names)
               sum = checksum(sum, vectors%names(i))
            end do
            sum = checksum(checksum(checksum(sum, vectors%first), vectors%dofs), vectors%values)
         end if
      end associate
      write (text, "(a, z8.8, a, i0, a)") "CRC-32 ", sum, ", ", structure%n_dofs, " degrees of freedom"
   end function structure_fingerprint

   integer function with_sparse(so_far, matrix) result(sum)
      integer, intent(in) :: so_far
      type(sparse_t), intent(in) :: matrix

      sum = so_far
      if (allocated(matrix%value)) sum = checksum(checksum(checksum(sum, matrix%first), matrix%column), matrix%value)
   end function with_sparse
end module hb_fe_model
